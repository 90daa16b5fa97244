"""The observation log, its exchange between agents, and the estimators that turn it into the hypothesis."""
