"""Whether a result predicts a log that it was not made from."""
