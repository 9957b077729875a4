"""What is in a .vc7 file? Run as a program of its own, since lvpyio ends its process on some files.

It writes an npz to standard output, or a line that begins with ! where the file is not read.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Any

__all__ = ["HEIGHT", "arrays_of"]

HEIGHT = "TS:Height"
# Address space beside what the file may unpack to: Python, numpy and lvpyio's libraries.
_OWN_SPACE, _UNPACKED = 4 * 2**30, 64


def arrays_of(path: Path) -> dict[str, Any]:
    """Displacement (rows, columns, 3), mask, height, and slope, offset and unit of each scale.

    Raises
    ------
    ValueError
        It holds no displacement in space with its height.
    """
    import lvpyio
    import numpy as np

    field = lvpyio.read_buffer(str(path))[0]
    if not getattr(field, "is_3c", False) or HEIGHT not in field.components:
        raise ValueError(
            f"holds no displacement in space with its height ({HEIGHT}); a bulge needs the result "
            "of a stereo evaluation"
        )
    vectors, height = field.as_masked_array(), field.components[HEIGHT]
    scales = {"x": field.scales.x, "y": field.scales.y, "i": field.scales.i, "z": height.scale}
    return {
        "displacement": np.stack([np.ma.getdata(vectors[key]) for key in "uvw"], axis=-1),
        "mask": np.ma.getmaskarray(vectors["u"]),
        "height": np.asarray(height.planes[0], dtype=np.float64),
        "grid": np.array([field.grid.x, field.grid.y], dtype=np.float64),
        **{f"line_{key}": np.array([s.slope, s.offset]) for key, s in scales.items()},
        **{f"unit_{key}": np.array(str(s.unit)) for key, s in scales.items()},
    }


def _limit_memory(path: Path) -> None:
    try:
        import resource
    except ImportError:  # not on Windows
        return
    space = _OWN_SPACE + _UNPACKED * path.stat().st_size
    resource.setrlimit(resource.RLIMIT_AS, (space, space))


def _main(path: Path) -> None:
    import numpy as np

    _limit_memory(path)
    output = io.BytesIO()
    try:
        np.savez(output, **arrays_of(path))
        answer = output.getvalue()
    except ImportError:
        answer = b"!lvpyio"
    except Exception as error:  # a damaged file can raise nearly anything
        answer = f"!{error}".encode()
    sys.stdout.buffer.write(answer)


if __name__ == "__main__":
    # the folder of this program, whose files are no modules of their own
    sys.path.pop(0)
    _main(Path(sys.argv[1]))
