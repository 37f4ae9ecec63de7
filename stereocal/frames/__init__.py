"""The photographs of all frames: pairs, targets and their labels, and a person's last word."""
