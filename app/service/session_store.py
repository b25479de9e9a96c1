"""Sessions in the database, and what is asked of them when they start."""

from __future__ import annotations

from dataclasses import dataclass

from app.motion.trajectory import Scene
from app.service.frames import Encoding, Layout
from app.service.geometry import Geometry
from app.service.session_errors import StartRefused


@dataclass(frozen=True)
class Wish:
    """What a session is asked to be; None leaves it to the model. table_height [m]; rate_hz [Hz]."""

    model: str
    geometry: Geometry
    version: str | None = None
    rate_hz: float | None = None
    objects: tuple[str, ...] | None = None
    table_height: float | None = None
    name: str | None = None
    encoding: Encoding = "json"

    def layout(self, roles: tuple[str, ...]) -> Layout:
        """Return what a frame holds. Raises StartRefused."""
        objects = roles if self.objects is None else self.objects
        if len(set(objects)) < len(objects) or not {"t", "hand"}.isdisjoint(objects):
            raise StartRefused(
                "objects_invalid", "objects need names of their own, other than `t` and `hand`"
            )
        if missing := [role for role in roles if role not in objects]:
            raise StartRefused("role_missing", f"the model needs an object named {missing[0]!r}")
        if self.encoding == "f32" and self.rate_hz is None:
            raise StartRefused("f32_needs_rate", "f32 cannot carry times: give `rate_hz`, or use f64")
        return Layout(objects, self.geometry, self.rate_hz, self.encoding)

    @property
    def scene(self) -> Scene | None:
        """What stands still, None: as the model says."""
        return None if self.table_height is None else Scene(self.table_height)
