"""What everything else stands on: arrays, rigid-body equations, files, limits, errors, text made safe."""
