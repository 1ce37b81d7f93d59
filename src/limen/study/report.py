"""The demo's report: one HTML file with everything in it."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from string import Template

import numpy as np
import simplejpeg
from numpy.typing import NDArray

from limen.data.image.file import Image
from limen.data.pages import PAGE
from limen.data.store.atomic import write_bytes
from limen.display.display import Display
from limen.geometry import Floats
from limen.layers.image.draw.uniforms import level_colours
from limen.study.moments import Moment
from limen.study.traffic import Report, Row
from limen.track.session import Session
from limen.viewing.placement import OnSurface
from limen.vision.acuity import HUMAN_ARCMIN

__all__ = ["Crop", "Scene", "Story", "write_report"]

Rgb = NDArray[np.uint8]


@dataclass(frozen=True)
class Scene:
    """One moment: the room, the unrolled wall, and the wall coloured by level."""

    moment: Moment
    room: Rgb
    wall: Rgb
    levels: Rgb
    level_share: Floats
    pages: int
    full_pages: int


@dataclass(frozen=True)
class Crop:
    """Part of a panel: all detail, what was drawn, and both as the eye resolves them from where it is."""

    panel: str
    distance_m: float
    level: int
    resolved_px: float
    full: Rgb
    drawn: Rgb
    full_seen: Rgb
    drawn_seen: Rgb


@dataclass(frozen=True)
class Story:
    """Everything that the report tells."""

    display: Display
    image: Image
    session: Session
    placement: OnSurface
    adapter: str
    scenes: Sequence[Scene]
    crops: Sequence[Crop]
    film: bytes
    reports: Sequence[Report]
    plots: Sequence[bytes]
    seconds: float


def write_report(path: Path, story: Story) -> Path:
    """Write the report; raises StorageError if the disk refuses."""
    template = Template((files("limen.study") / "report.html").read_text(encoding="utf-8"))
    text = template.substitute(_fields(story))
    return write_bytes(path, text.encode())


def _fields(story: Story) -> dict[str, str]:
    image, display = story.image, story.display
    own, paper = (report.summary() for report in story.reports)
    rows = own.sessions[0].rows
    human = next(row for row in rows if row.acuity_arcmin == HUMAN_ARCMIN)
    name = html.escape(image.path.name)
    walk = html.escape(story.session.name)
    return {
        "title": f"limen: {name} on {len(display.panels)} panels",
        "headline": _headline(story, human),
        "lead": _lead(story, rows[0], human),
        "film": _data(story.film, "image/webp"),
        "film_caption": "The first minute, sped up. Red is full resolution; each step of colour halves it.",
        "key": _key(story),
        "tiles": _tiles(rows[0], human),
        "moments_text": _MOMENTS,
        "scenes": "\n".join(_scene(scene) for scene in story.scenes),
        "crops_text": _CROPS,
        "crops": "\n".join(_crop(crop) for crop in story.crops),
        "traffic_text": _TRAFFIC,
        "table": _table(rows, "walk A"),
        "plot": _inline(story.plots[0]),
        "plot_caption": f"Walk {walk}, 30 frames a second; a page of this image takes {own.page_bytes / 1000:.1f} kB.",
        "paper_text": _PAPER,
        "paper_table": "".join(_table(session.rows, f"walk {html.escape(session.name)}") for session in paper.sessions),
        "paper_plot": _inline(story.plots[1]),
        "made_text": (
            f"{name}: {image.size_px[0]:,} x {image.size_px[1]:,} texels, {len(image.pyramid.levels)} levels, "
            f"{image.path.stat().st_size / 1e6:,.0f} MB on disk, placed with fit '{story.placement.fit}'. "
            f"Drawn by {html.escape(story.adapter)}, in {story.seconds:.0f} seconds."
        ),
        "commands": html.escape(_commands(image)),
        "footer": f"limen {version('limen')}",
    }


_MOMENTS = (
    "Each moment shows the room as it is lit, the walls unrolled (the front wall in the middle, the seam in the middle "
    "of the back wall), and the level of the image's pyramid that every place is drawn from."
)
_CROPS = (
    "Left: all the detail that the panel could show. Right: what was drawn for the visitor. Below, both again as her "
    f"eye resolves them from where she stands ({HUMAN_ARCMIN} arcminutes, the median of what people were measured to "
    "resolve). If the upper pictures differ and the lower ones do not, the difference was not hers to see."
)
_TRAFFIC = (
    f"Pages of {PAGE} x {PAGE} texels that a frame of this walk needs, with nothing kept from the frame before, as for "
    "data that changes all the time. The floor counts the samples that eyes of that acuity could resolve at all; "
    "texels over floor tells how far from that limit the pages are."
)
_PAPER = (
    "The test of Papadopoulos and Kaufman (2013): three synthetic walks, the front, left and right wall, an image with "
    "one texel on every pixel, pages of 9 kB. One arcminute is the formula as printed."
)


def _headline(story: Story, human: Row) -> str:
    width, height = story.image.size_px
    what = f"{_giga(width * height)} on {len(story.display.panels)} panels"
    return f"{what}: {_percent(human.saving)} of it need not move" if human.saving >= 0.05 else what


def _lead(story: Story, full: Row, human: Row) -> str:
    display = story.display
    text = (
        f"A visitor walks for {story.session.duration_s:.0f} seconds through the {html.escape(display.name)}, "
        f"{display.total_px / 1e9:.2f} gigapixels of panels on four walls. limen knows where her eyes are, and draws "
        f"every place at the detail that she can resolve from there: {human.pages_mean:,.0f} pages a frame instead of "
        f"{full.pages_mean:,.0f}."
    )
    texel_px = display.pitch_m * story.placement.texels_per_m(display, story.image.size_px)
    if texel_px < 0.95:
        text += (
            f" The image has fewer texels than the walls have pixels (one texel covers {1 / texel_px:.1f} pixels), so "
            "there is less to leave out than with an image that fills them."
        )
    return text


def _giga(pixels: int) -> str:
    return f"{pixels / 1e9:.2f} gigapixels" if pixels >= 1e9 else f"{pixels / 1e6:,.0f} megapixels"


def _percent(share: float) -> str:
    return f"{share * 100:.0f} %"


def _tiles(full: Row, human: Row) -> str:
    tiles = (
        (_percent(human.saving), "of the pages need not move (0.64 arcminutes)"),
        (f"{human.pages_mean:,.0f}", f"pages a frame instead of {full.pages_mean:,.0f}"),
        (f"{human.bytes_per_s / 1e6:,.0f} MB/s", f"at 30 frames a second instead of {full.bytes_per_s / 1e6:,.0f}"),
        (f"{human.texels_over_floor:.1f} x", "the samples that an eye could resolve: the physical floor"),
    )
    return "".join(f'<div class="tile"><b>{value}</b>{text}</div>' for value, text in tiles)


def _key(story: Story) -> str:
    used = np.max([scene.level_share for scene in story.scenes], axis=0)
    deepest = int(np.flatnonzero(used).max(initial=0))
    colours = (level_colours(len(used)) * 255).astype(int)
    items = (
        f'<li><i style="background:rgb({r},{g},{b})"></i>level {level}: 1 texel for {4**level:,}</li>'
        for level, (r, g, b) in enumerate(colours[: deepest + 1].tolist())
    )
    return f'<ul class="key">{"".join(items)}</ul>'


def _scene(scene: Scene) -> str:
    viewer = scene.moment.viewers[0]
    shares = ", ".join(
        f"{_percent(share)} at level {level}" for level, share in enumerate(scene.level_share) if share >= 0.005
    )
    return f"""
<h3>{html.escape(scene.moment.title)}</h3>
<p class="quiet">At {viewer.time_s:.0f} s, {scene.moment.distance_m:.2f} m from the nearest panel:
{scene.pages:,} pages instead of {scene.full_pages:,}. {shares}.</p>
<figure><img src="{_jpeg(scene.room)}" alt="The room at this moment"></figure>
<figure><img src="{_jpeg(scene.wall)}" alt="The walls unrolled"></figure>
<figure><img src="{_jpeg(scene.levels)}" alt="The walls coloured by level"></figure>"""


def _crop(crop: Crop) -> str:
    drawn = "full resolution" if crop.level == 0 else f"level {crop.level}, one texel for {4**crop.level}"
    merge = (
        f"{crop.resolved_px:.1f} pixels merge into one for the eye"
        if crop.resolved_px > 1
        else "every pixel can be seen"
    )
    pictures = (
        (crop.full, "all detail"),
        (crop.drawn, f"drawn: {drawn}"),
        (crop.full_seen, "all detail, as the eye resolves it"),
        (crop.drawn_seen, "drawn, as the eye resolves it"),
    )
    figures = "".join(
        f'<figure><img src="{_jpeg(picture)}" alt="{text}"><figcaption>{text}</figcaption></figure>'
        for picture, text in pictures
    )
    return (
        f"<h3>Panel {html.escape(crop.panel)}, {crop.distance_m:.1f} m away</h3>"
        f'<p class="quiet">{merge[0].upper() + merge[1:]}.</p><div class="pair">{figures}</div>'
    )


def _table(rows: Sequence[Row], name: str) -> str:
    head = ("", "policy", "pages a frame", "99th percentile", "MB a frame", "saved", "texels over floor")
    body = []
    for number, row in enumerate(rows):
        label = row.policy if row.acuity_arcmin is None else f"{row.policy}, {row.acuity_arcmin:g} arcmin"
        cells = (
            name if number == 0 else "", label, f"{row.pages_mean:,.0f}", f"{row.pages_p99:,.0f}",
            f"{row.bytes_mean / 1e6:,.1f}", f"{row.saving * 100:.1f} %", f"{row.texels_over_floor:.1f}",
        )  # fmt: skip
        body.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return f"<table><tr>{''.join(f'<th>{cell}</th>' for cell in head)}</tr>{''.join(body)}</table>"


def _commands(image: Image) -> str:
    name = image.path.name
    return "\n".join(
        (
            f"limen traffic {name} --display reality-deck --session A",
            f"limen show {name} --display reality-deck --session A --frames 3 --out frames --scale 0.125 --simulate",
            "limen traffic one-to-one --display reality-deck --panels 'front/*' 'left/*' 'right/*' --session A B C",
        )
    )


def _jpeg(picture: Rgb) -> str:
    data = simplejpeg.encode_jpeg(np.ascontiguousarray(picture), quality=86, colorspace="RGB", colorsubsampling="444")
    return _data(data, "image/jpeg")


def _data(content: bytes, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _inline(svg: bytes) -> str:
    """An SVG without its XML head, as HTML wants it."""
    text = svg.decode()
    return text[text.index("<svg") :]
