"""The paper's Section 6: splits, counts, intervals, summary."""
