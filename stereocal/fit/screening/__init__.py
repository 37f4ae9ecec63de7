"""Which frames and images contradict the others, and what they have in common."""
