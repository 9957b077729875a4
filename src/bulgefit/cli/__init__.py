"""How do I run it? One thin module per verb."""
