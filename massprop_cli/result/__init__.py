"""The contract of a result's files: schema, build, read, write, judge, compare."""
