"""The membrane's laws: one file a law, and the table that they are looked up in by name."""

from bulgefit.fem.laws.registry import LAWS

__all__ = ["LAWS"]
