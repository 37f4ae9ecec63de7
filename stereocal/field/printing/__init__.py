"""What is printed before the field day: targets, boards, the field sheet."""
