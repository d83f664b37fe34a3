"""Several results of one vehicle made one: information adds up, what they share is carried once, and what contradicts is told."""
