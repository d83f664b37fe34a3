"""Test whether a result predicts another log."""
