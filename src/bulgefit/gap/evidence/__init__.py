"""Which effects does the data speak for? All freed at once under priors, then weighed."""
