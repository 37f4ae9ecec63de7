"""The paper's methods: essential matrix, costs, Monte Carlo search; checks and results."""
