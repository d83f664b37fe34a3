"""History → Conclusion: verdicts, contradictions, assumptions, the docked object."""
