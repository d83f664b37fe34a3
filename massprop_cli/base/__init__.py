"""Foundations: arrays, rigid-body equations, files, input limits, errors, escaped text."""
