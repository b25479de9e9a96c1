"""The files and messages of the field that a movement goes out as: CSV, ROS 2 messages, MCAP.

Each format is a pure function of a ``Motion``. It raises nothing of its own: whoever generated the movement
has made sure that there is at least one frame, that times increase and that all is finite.
"""
