"""The files and messages of the field that motion comes in as and goes out as.

**In**: ``reading.read`` makes a ``Capture`` of a recording, ``isolation.read_apart`` does so in a process of
its own; ``mapping`` makes a trajectory of it, ``proposal`` a mapping to begin with, ``labels`` its segments.
What is refused is refused by an error of the tree in ``errors``.

**Out**: a generated movement as CSV, ROS 2 messages or MCAP. Each format is a pure function of a ``Motion``.
It raises nothing of its own: whoever generated the movement has made sure that there is at least one frame,
that times increase and that all is finite.
"""
