"""Recordings of other programs: readers (``recording``), the map that makes a log (``mapfile``, ``mapped``), and drafts of both files."""
