"""Counts as colours, with a bar that says what they mean."""

import numpy as np
import PIL.Image
import PIL.ImageDraw
import PIL.ImageFont

# viridis (Smith & van der Walt 2015, CC0) in sixteenths; between them it is straight to 1 %.
VIRIDIS = """440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c 1fa088 28ae80 3fbc73 5ec962 84d44b addc30
d8e219 fde725"""
_STOPS = np.array([list(bytes.fromhex(code)) for code in VIRIDIS.split()], dtype=float)


def viridis(x: np.ndarray) -> np.ndarray:
    """(..., 3) uint8 sRGB for numbers in [0, 1]: even in lightness, also without colour vision."""
    places = np.linspace(0, 1, len(_STOPS))
    return np.rint(np.stack([np.interp(x, places, stops) for stops in _STOPS.T], axis=-1)).astype(np.uint8)


def heat_map(counts: np.ndarray) -> PIL.Image.Image:
    """(height, width) counts of at least 0 from dark to bright, and beside them a bar with numbers.

    The brightest colour stands for all of the top half percent: its number is then followed by a "+".
    """
    # A few that stand out would leave all others in the dark.
    most = max(1, int(np.percentile(counts, 99.5, method="higher")))
    picture = PIL.Image.fromarray(viridis(np.minimum(counts / most, 1)))
    labels = {tick: str(tick) for tick in _ticks(most)}
    if counts.max() > most:
        labels[most] += "+"
    font = PIL.ImageFont.load_default()
    pen = PIL.ImageDraw.Draw(picture)
    boxes = np.array([pen.textbbox((0, 0), label, font=font) for label in labels.values()])
    text_width, text_height = (int(np.ceil(side)) for side in boxes[:, 2:].max(axis=0))
    gap, bar = 6, 12
    # A picture lower than two numbers gets room for them.
    height = max(picture.height, 3 * text_height)
    canvas = PIL.Image.new("RGB", (picture.width + gap + bar + gap + text_width + gap, height), "white")
    canvas.paste(picture)
    first, last = text_height // 2, height - 1 - text_height // 2
    ramp = viridis(np.linspace(1, 0, last - first + 1))
    canvas.paste(PIL.Image.fromarray(np.repeat(ramp[:, None], bar, axis=1)), (picture.width + gap, first))
    pen = PIL.ImageDraw.Draw(canvas)
    used = height + text_height
    for tick, label in labels.items():
        row = round(last - (last - first) * tick / most)
        # From below, and no two over each other; the last one, the most, is worth more than those close to it.
        if used - row < text_height + 2 or (tick != most and row - first < text_height + 2 and tick > 0):
            continue
        used = row
        x = picture.width + gap + bar
        pen.line([(x, row), (x + gap // 2, row)], fill="black")
        pen.text((x + gap, row - text_height / 2), label, fill="black", font=font)
    return canvas


def _ticks(most: int) -> list[int]:
    """0, multiples of a round number, and the most."""
    step = 1
    while most / step > 8:
        # 1, 2, 5, 10, 20, ...
        step = step * 5 // 2 if str(step)[0] == "2" else step * 2
    return sorted({*range(0, most, step), most})
