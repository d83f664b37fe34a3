"""History → Conclusion: verdicts, contradictions, sensitivity to assumptions, the docked object."""
