"""How do I see it? Figures and pictures; each module is imported on its own."""
