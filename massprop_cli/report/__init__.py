"""Reports of results in several formats; each format is a function from results to text or a file."""
