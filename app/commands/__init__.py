"""The commands of ``gesta``, one a file: of a server and its data, and of clients, which ask over the API.

A file loads the libraries of its command; what only some of its runs need is imported there.
"""
