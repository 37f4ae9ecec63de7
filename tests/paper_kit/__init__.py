"""The paper kit: what it says, and what opens of it."""
