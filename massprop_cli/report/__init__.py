"""Results for people and machines. Each format is a function from an analysis to text or a file."""
