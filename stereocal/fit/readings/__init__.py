"""What was given wrongly: other readings of the input, judged by what they leave."""
