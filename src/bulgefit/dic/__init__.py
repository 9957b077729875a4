"""What was measured, and how well?"""

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.dic.check import require_increasing
from bulgefit.dic.inspect import TestInfo, describe
from bulgefit.dic.readers import READERS, Recording, read_test, reader
from bulgefit.dic.writers import write_test

__all__ = [
    "READERS",
    "Block",
    "BulgeTest",
    "Recording",
    "TestInfo",
    "describe",
    "read_test",
    "reader",
    "require_increasing",
    "write_test",
]
