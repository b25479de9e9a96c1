"""``gesta bridge``: what a motion-capture program sends, as a stream to a server."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing
from itertools import chain
from typing import Annotated, Any, Literal

import typer

from app.client import GestaClient
from app.commands.asking import URL, Url, Version, asking, number_of
from app.commands.frame_lines import FrameLines
from app.commands.frame_sources import lines_of_datagrams, lines_of_input
from app.commands.live import Block, run, until_stopped
from app.commands.lsl import Channels, opened_inlet, samples
from app.commands.terminal import AsJson, failure, tell

bridge = typer.Typer(
    name="bridge",
    help="Stream what a motion-capture program sends, and tell the segments as they are recognised.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

LINES = """Stream frames that come as lines of JSON, on standard input or as UDP datagrams.

\b
Each is a frame:
{"t": 0.01, "hand": [x, y, z], "objects": {"cup": [x, y, z]}}

The time t is in seconds and increases; a position that is missing is null. What is no frame is told by its
number and left out.

Ctrl-C, or the end of the input, ends the stream; the last segments are awaited. A connection that breaks is
made anew, meanwhile frames wait.
"""
SAMPLES = """Stream the positions of a Lab Streaming Layer stream.

Its channels are called NAME.x, NAME.y, NAME.z (or NAME_x, NAME X, …), by its own description or by
--channels; the track called hand is the hand. NaN is a dropout.

Ctrl-C ends the stream; the last segments are awaited.
"""

StreamModel = Annotated[str, typer.Option("--model", help="Whose actions are to be found.")]
Name = Annotated[str | None, typer.Option(help="Of the session.")]
Up = Annotated[Literal["z", "y"], typer.Option(help="Axis that is up.")]


@bridge.command(help=LINES)
def jsonl(
    model: StreamModel,
    version: Version = None,
    udp: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Where datagrams come; default: standard input.")
    ] = None,
    objects: Annotated[
        list[str] | None, typer.Option("--object", help="Repeat; default: those of the first frame.")
    ] = None,
    rate: Annotated[
        float | None, typer.Option(min=0.1, help="Frames per second; then no line has a `t`.")
    ] = None,
    unit: Annotated[Literal["m", "cm", "mm"], typer.Option(help="Of the positions.")] = "m",
    up: Up = "z",
    name: Name = None,
    as_json: AsJson = False,
    url: Url = URL,
) -> None:
    """Stream frames that come as lines of JSON: see LINES."""
    with asking(url) as client, until_stopped() as stopped:
        start = _start(client, model, version, unit, up, name) | {"rate_hz": rate}
        lines = FrameLines(objects, unit, rate)
        source = lines_of_input(stopped) if udp is None else lines_of_datagrams(udp, stopped)
        with closing(source):
            blocks = lines.blocks(source)
            first = next((block for block in blocks if len(block.hand)), None)
            if first is None:
                raise failure("no frame came")
            start["objects"] = list(first.objects)
            with client.stream(model, **start) as stream:
                run(stream, chain([first], blocks), as_json, stopped)
    if lines.n_bad:
        tell(f"{lines.n_bad} of {lines.n_lines} lines were no frames", "yellow")


@bridge.command(help=SAMPLES)
def lsl(
    model: StreamModel,
    stream_name: Annotated[str, typer.Option("--stream", help="The name of the LSL stream.")],
    version: Version = None,
    channels: Annotated[
        str | None, typer.Option(help="Names of its channels, with commas; `-` leaves one out.")
    ] = None,
    unit: Annotated[
        Literal["m", "cm", "mm"] | None, typer.Option(help="Where the stream does not say it.")
    ] = None,
    up: Up = "z",
    name: Name = None,
    as_json: AsJson = False,
    url: Url = URL,
) -> None:
    """Stream the positions of a Lab Streaming Layer stream: see SAMPLES."""
    with asking(url) as client, until_stopped() as stopped, opened_inlet(stream_name) as inlet:
        named = Channels.of(inlet, channels, unit)
        start = _start(client, model, version, named.unit, up, name or stream_name)
        blocks: Iterator[Block] = samples(inlet, named, stopped)
        with client.stream(model, objects=named.objects, **start) as stream:
            run(stream, blocks, as_json, stopped)


def _start(
    client: GestaClient, model: str, version: str | None, unit: str, up: str, name: str | None
) -> dict[str, Any]:
    """Return how the stream starts; the model is looked up before the first frame comes."""
    geometry: Mapping[str, str] = {"length_unit": unit, "up_axis": up}
    return {
        "version": number_of(client, model, version),
        "geometry": geometry,
        "name": name,
        "options": {"hypotheses": False},
    }
