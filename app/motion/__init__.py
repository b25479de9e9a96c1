"""The core: learns, recognises and re-enacts actions; arrays in, arrays out.

Positions are in metres, times in seconds, the third axis is up. Nothing here knows of files, databases,
the web or a clock, and every random draw takes a seed.
"""
