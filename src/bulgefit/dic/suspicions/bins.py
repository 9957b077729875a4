"""Do points stand at the centres of bins that are cut?"""

from __future__ import annotations

from collections.abc import Iterator

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.cut_bins import cut_bins
from bulgefit.dic.suspicions.suspicion import Suspicion

__all__ = ["about_bins"]


def about_bins(test: BulgeTest) -> Iterator[Suspicion]:
    """Bins at the edge that show the field further inside."""
    found = [one for one in map(cut_bins, test.blocks) if one is not None]
    if found:
        worst = max(found, key=lambda one: one.shift)
        yield Suspicion(
            "bins_cut",
            f"points lie on a grid of {worst.width:.3g} mm, and those at its edge show what is "
            f"{worst.shift:.2g} ± {worst.error:.1g} mm further inside: means over bins that the "
            "rim or a hole cuts, given at the bins' centres",
            "give each bin's mean position, or leave the cut ones out: bulgefit convert IN OUT "
            "--whole-bins; bulgefit diagnose leaves them out",
        )
