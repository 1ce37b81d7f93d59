"""Any other image through libvips, brought to 8-bit sRGB with 3 or 4 bands."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pyvips
from numpy.typing import NDArray

from limen.data.store.report import one_line
from limen.data.store.resample import LINEAR_OF_SRGB, SRGB_OF_LINEAR
from limen.errors import FormatError

__all__ = ["halvings", "load", "profile_name", "texels_of", "to_srgb"]

Texels = NDArray[np.uint8]


def load(path: Path, *, sequential: bool) -> pyvips.Image:
    """The file as libvips sees it, nothing decoded yet; FormatError if it knows no such format.

    ``sequential`` promises that rows are asked for from top to bottom once, and keeps memory bounded.
    """
    access = "sequential" if sequential else "random"
    try:
        image = pyvips.Image.new_from_file(str(path), access=access, fail_on="error")
    except pyvips.Error as error:
        if path.exists() and not _is_known(path):
            raise FormatError(
                f"{path}: is of no image format that limen reads: make a TIFF, PNG or JPEG of it"
            ) from error
        raise FormatError(f"{path}: is not an image that can be read, or it is damaged ({one_line(error)})") from error
    if image.format not in ("uchar", "ushort") and image.interpretation not in ("scrgb", "lab", "xyz"):
        raise FormatError(f"{path}: holds {image.format} samples without a colour meaning; export it with 8 or 16 bits")
    return image


def _is_known(path: Path) -> bool:
    """Whether libvips has something that loads files of this kind: what it fails to load then is damaged."""
    known = pyvips.vips_lib.vips_foreign_find_load(os.fsencode(path)) != pyvips.ffi.NULL
    pyvips.vips_lib.vips_error_clear()  # or the next error would repeat what was found out here
    return bool(known)


def profile_name(profile: bytes | None) -> str:
    """'none', 'sRGB' or 'other' for an embedded ICC profile."""
    if not profile:
        return "none"
    return "sRGB" if b"sRGB" in profile or "sRGB".encode("utf-16-be") in profile else "other"


def to_srgb(image: pyvips.Image) -> pyvips.Image:
    """8-bit sRGB with 3 bands, or 4 where the image has opacity; embedded profiles are applied."""
    profile = image.get("icc-profile-data") if image.get_typeof("icc-profile-data") else None
    if profile_name(profile) == "other":
        image = image.icc_transform("srgb", embedded=True, intent="relative", depth=8)
    elif image.interpretation in ("multiband", "matrix"):
        image = image.copy(interpretation=_likely(image))
    if image.interpretation != "srgb":
        image = image.colourspace("srgb")
    if image.format != "uchar":
        image = image.cast("uchar")
    if image.bands > 4:
        image = image.extract_band(0, n=3)
    return image


def _likely(image: pyvips.Image) -> str:
    wide = image.format == "ushort"
    return ("rgb16" if wide else "srgb") if image.bands >= 3 else ("grey16" if wide else "b-w")


def texels_of(image: pyvips.Image) -> Texels:
    """All texels of an 8-bit image, (h, w, bands), decoded now; pyvips.Error if that fails."""
    buffer = image.write_to_memory()
    return np.ndarray(shape=(image.height, image.width, image.bands), dtype=np.uint8, buffer=buffer)


def halvings(texels: Texels, levels: int) -> list[Texels]:
    """``texels`` (h, w, 3 or 4) and its next ``levels`` halvings, sizes rounding up, in linear light."""
    height, width, bands = texels.shape
    found = [texels]
    for _ in range(levels):
        image = pyvips.Image.new_from_memory(found[-1].tobytes(), width, height, bands, "uchar")
        width, height = -(-width // 2), -(-height // 2)
        found.append(texels_of(_halved(image.embed(0, 0, width * 2, height * 2, extend="copy"))))
    return found


def _halved(image: pyvips.Image) -> pyvips.Image:
    to_linear = pyvips.Image.new_from_array([[round(float(x) * 65535.0) for x in LINEAR_OF_SRGB]]).cast("ushort")
    to_code = pyvips.Image.new_from_memory(SRGB_OF_LINEAR.tobytes(), 65536, 1, 1, "uchar")
    opacity = image.extract_band(3) if image.bands == 4 else None
    colour = image.extract_band(0, n=3) if opacity is not None else image
    light = colour.maplut(to_linear)
    if opacity is None:
        return (_reduced(light) + 0.5).cast("ushort").maplut(to_code)
    share = opacity.cast("float") / 255.0
    thin = _reduced(share)
    weighed = _reduced(light * share) / (thin > 1e-6).ifthenelse(thin, 1e-6)
    codes = (weighed + 0.5).cast("ushort").maplut(to_code)
    return codes.bandjoin((thin * 255.0 + 0.5).cast("uchar"))


def _reduced(image: pyvips.Image) -> pyvips.Image:
    # In float: with integers libvips would clip what overshoots between its vertical and its horizontal pass.
    return image.cast("float").reduce(2.0, 2.0, kernel="lanczos2")
