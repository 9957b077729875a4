"""How do pictures of one size become a film? A GIF of one palette, or an MP4 by ffmpeg."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError
from bulgefit.files import as_path, atomic_path, atomic_write_bytes, check_output

__all__ = ["FILMS", "check_film", "write_film"]

FILMS = (".gif", ".mp4")
#: Milliseconds a picture is seen, and the last one; the latter is a multiple of the former.
_EACH, _LAST = 120, 1200


def check_film(path: str | os.PathLike[str], force: bool = False) -> None:
    """Refuse a film that cannot be written, before its pictures are drawn."""
    suffix = as_path(path).suffix.lower()
    if suffix not in FILMS:
        raise InputError(f"{path}: give a name that ends in {' or '.join(FILMS)}")
    check_output(path, force)
    if suffix == ".mp4":
        _ffmpeg(path)


def write_film(
    images: Sequence[NDArray[np.uint8]], path: str | os.PathLike[str], force: bool = False
) -> None:
    """Write pictures (rows, columns, 3) of one size, with an even number of rows and columns."""
    if Path(path).suffix.lower() == ".mp4":
        _write_mp4(images, path, force)
    else:
        atomic_write_bytes(path, _gif(images), force)


def _write_mp4(
    images: Sequence[NDArray[np.uint8]], path: str | os.PathLike[str], force: bool
) -> None:
    ffmpeg = _ffmpeg(path)
    rows, columns, _ = images[0].shape
    with atomic_path(path, force) as unfinished:
        film = ffmpeg.write_frames(
            str(unfinished), (columns, rows), fps=1000 / _EACH, quality=8, macro_block_size=2,
            codec="libx264", ffmpeg_log_level="error",
            output_params=["-movflags", "+faststart"],
        )  # fmt: skip
        film.send(None)
        try:
            for image in [*images, *([images[-1]] * (_LAST // _EACH - 1))]:
                film.send(np.ascontiguousarray(image))
        finally:
            film.close()


def _ffmpeg(path: str | os.PathLike[str]) -> Any:
    try:
        import imageio_ffmpeg
    except ImportError:
        raise InputError(
            f"{path}: an .mp4 needs imageio-ffmpeg, which is not installed; pip install "
            '"bulgefit[movie]" brings it, and a .gif needs nothing'
        ) from None
    return imageio_ffmpeg


def _gif(images: Sequence[NDArray[np.uint8]]) -> bytes:
    from PIL import Image

    # one palette for all pictures, so that nothing flickers
    some = np.concatenate([image[::3, ::3] for image in images])
    palette = Image.fromarray(some).quantize(256)
    frames = [Image.fromarray(image).quantize(palette=palette) for image in images]
    durations = [_EACH] * (len(frames) - 1) + [_LAST]
    buffer = io.BytesIO()
    frames[0].save(
        buffer, format="GIF", save_all=True, append_images=frames[1:], duration=durations, loop=0,
        optimize=False,
    )  # fmt: skip
    return buffer.getvalue()
