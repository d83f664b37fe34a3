"""Recordings of other programs: readers that give named streams, the map file that makes a log of them, and the drafts of both files.

``recording`` is the seam: a reader turns a file's bytes into streams, each with its path in the file, its unit where one is recorded, and
the stream that clocks it. ``mapfile`` is the model of the map, ``mapped`` makes the log's table by it (``streams`` finds them, ``resample``
puts them on records and cycles). ``columns`` lists a file, ``propose`` drafts its map and ``draft`` the vehicle file.
"""
