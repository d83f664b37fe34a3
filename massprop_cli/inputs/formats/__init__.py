"""Recordings of other programs: readers (``recording``), conversion by a map (``mapfile``, ``mapped``), and drafts of files."""
