"""Equations of motion of each environment, motion within a control cycle, and the linear state-space system with Q and R."""
