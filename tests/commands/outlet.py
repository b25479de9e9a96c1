"""``python outlet.py NAME CHANNELS LINES RATE``: stream frames by LSL, once somebody listens.

They come as lines of JSON. The channels, described where they have names, are the hand, the object, and one
more; in metres.
"""

from __future__ import annotations

import json
import sys
import time
from importlib import import_module
from pathlib import Path

MISSING = [float("nan")] * 3
LINGER_S = 1.0


def main(name: str, channels: str, lines: str, rate: str) -> None:
    """Stream, and stay for a moment."""
    pylsl = import_module("pylsl")
    info = pylsl.StreamInfo(name, "MoCap", 7, float(rate), "double64", name)
    described = info.desc().append_child("channels")
    for label in filter(None, channels.split(",")):
        channel = described.append_child("channel")
        channel.append_child_value("label", label)
        channel.append_child_value("unit", "none" if label == "pad" else "meters")
    outlet = pylsl.StreamOutlet(info)
    while not outlet.wait_for_consumers(60.0):
        pass
    for line in Path(lines).read_text().splitlines():
        frame = json.loads(line)
        row = [*(frame["hand"] or MISSING), *(frame["objects"]["object"] or MISSING), 7.0]
        outlet.push_sample(row, frame["t"])
        time.sleep(0.001)
    time.sleep(LINGER_S)


if __name__ == "__main__":
    main(*sys.argv[1:])
