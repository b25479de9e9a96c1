"""Generation: trajectories of learned actions between given end points, in the form that is asked for."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Response
from starlette.responses import JSONResponse

from app.api.dependencies import LabOf
from app.api.generation_asked import Generation, TaskSent
from app.api.generation_told import GeneratedTold, StepTold, TaskTold
from app.api.representations import Form, choose
from app.api.schemas import refusals
from app.service.exports import Pose, csv
from app.service.generation import Generated, generate_trajectory, generate_trajectory_of_task

router = APIRouter(prefix="/v1/models/{model}/versions/{ref}", tags=["trajectories"])

JSON, CSV, MCAP = Form("application/json"), Form("text/csv"), Form("application/vnd.mcap")
PATH = Form("application/json", "nav_msgs/Path")
MULTI_DOF = Form("application/json", "trajectory_msgs/MultiDOFJointTrajectory")
FORMS = (JSON, PATH, MULTI_DOF, CSV, MCAP)

HEADERS = {
    "Gesta-Model": "The model.",
    "Gesta-Version": "The number of its version.",
    "Gesta-Feasible": "`true` or `false`: whether nothing is violated.",
    "Gesta-Violations": "Kinds of what is violated, separated by commas.",
    "Gesta-Warnings": "Codes of what is to be known, separated by commas.",
}

Accept = Annotated[
    str, Header(max_length=1000, description=f"One of {', '.join(f'`{form}`' for form in FORMS)}.")
]


def _answers() -> dict[int | str, dict[str, Any]]:
    """Return what OpenAPI says of the forms and of what can go wrong."""
    headers = {name: {"description": what, "schema": {"type": "string"}} for name, what in HEADERS.items()}
    content = {
        str(PATH): {"schema": {"type": "object"}},
        str(MULTI_DOF): {"schema": {"type": "object"}},
        str(CSV): {"schema": {"type": "string"}},
        str(MCAP): {"schema": {"type": "string", "format": "binary"}},
    }
    return {200: {"content": content, "headers": headers}, **refusals(404, 406, 503)}


@router.post(
    "/actions/{action}/trajectories",
    summary="Generate a trajectory",
    response_model=GeneratedTold,
    responses=_answers(),
)
def generate(
    model: str, ref: str, action: str, body: Generation, lab: LabOf, accept: Accept = "*/*"
) -> Response:
    """The shape is learned, the end points are yours: nobody needs to have demonstrated them.

    It starts and ends at rest and keeps the limits. What it violates, and what is to be known about it, is in
    `feasibility`, and in headers.
    """
    form, pose = choose(accept, FORMS), Pose.of(body.frame_id, body.orientation)
    generated = generate_trajectory(lab, model, ref, body.start, body.step(action), body.manner())
    if form == JSON:
        told = GeneratedTold.of(generated, body.frame_id, action=action)
        return Response(told.model_dump_json(), media_type=str(JSON), headers=_headers(generated))
    return _exported(generated, form, pose)


@router.post("/trajectories", summary="Generate a task", response_model=TaskTold, responses=_answers())
def generate_task(model: str, ref: str, body: TaskSent, lab: LabOf, accept: Accept = "*/*") -> Response:
    """One continuous trajectory through several actions; it rests where one ends and the next begins."""
    form, pose = choose(accept, FORMS), Pose.of(body.frame_id, body.orientation)
    steps = [step.step(step.action) for step in body.steps]
    generated = generate_trajectory_of_task(lab, model, ref, body.start, steps, body.manner())
    if form == JSON:
        told = TaskTold.of(generated, body.frame_id, steps=StepTold.all_of(steps, generated.ends))
        return Response(told.model_dump_json(), media_type=str(JSON), headers=_headers(generated))
    return _exported(generated, form, pose)


def _exported(generated: Generated, form: Form, pose: Pose) -> Response:
    """Return a trajectory in another form than JSON of ours."""
    headers, motion = _headers(generated), generated.motion
    if form == CSV:
        return Response(csv(motion), media_type=str(CSV), headers=headers)
    if form == MCAP:
        return Response(pose.bag(motion), media_type=str(MCAP), headers=headers)
    message = pose.path(motion) if form == PATH else pose.trajectory(motion)
    return JSONResponse(message, media_type=str(form), headers=headers)


def _headers(generated: Generated) -> dict[str, str]:
    """Return what a robot needs to know whatever the form is."""
    version, violations = generated.version, generated.violations
    values = (
        version.model,
        str(version.number),
        "false" if violations else "true",
        ", ".join(dict.fromkeys(each.kind for each in violations)),
        ", ".join(dict.fromkeys(each.code for each in generated.motion.notices)),
    )
    return dict(zip(HEADERS, values, strict=True))
