"""The paper kit: what it says, draws, and computes again."""
