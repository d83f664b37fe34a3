"""What a body with given mass properties would do: plants, motion within a cycle, the linear system with its Q and R."""
