"""The printed lines of ruled or squared paper are taken out of the ink.

A rule is a straight line across most of the page with at least five more like it beside it.  Lines are found by Hough's
transform, one by one, so that a page seen at a slant is no exception; each is fitted to its pixels, and what lies on it
and is no darker than the line itself usually is goes.  A stroke that crosses it is darker, or is joined again across it.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64

Grey = Float32[np.ndarray, "H W"]
SPAN = 0.4  # of the page's width, that a rule is seen along
WHOLE = 0.75
FAMILY = 6  # rules that a ruled page has at least
MOST_TURN_DEG = 12.0  # rules are about level or upright
MOST_LINES = 6000
MOST_RULES = 200
MOST_MISSES = 1500  # lines that no ink stands on; the strongest come first
DARKER = 1.45  # ink is at least so much darker than a rule
_REACH = 6  # pixels up and down from a line in which it is fitted


@dataclass(frozen=True)
class _Rule:
    """y = a + b x of a line that is about level."""

    a: float
    b: float
    half: float
    """Half of its width, pixels."""
    dark: float
    span: float
    """Share of the page's width along which it is seen."""


def without_rules(dark: Grey, faintest: float) -> Grey:
    """(H, W) darkness 0-1 without the rules of the paper; the same array where there are none.

    faintest : darkness from which a pixel may belong to a rule.
    """
    pages = (dark, np.ascontiguousarray(dark.T))
    lines = [_lines(page, faintest) for page in pages]
    families = [_family(found, page.shape[1]) for found, page in zip(lines, pages, strict=True)]
    if not any(families):
        return dark
    # on a ruled page a printed line all across it the other way is its margin
    usual = float(np.median([rule.dark for family in families for rule in family]))
    level, upright = (
        own or [line for line in found if line.span > WHOLE and line.dark < DARKER * usual]
        for own, found in zip(families, lines, strict=True)
    )
    out = dark
    for rules, turned in ((level, False), (upright, True)):
        if rules:
            page = np.ascontiguousarray(out.T) if turned else out.copy()
            for rule in rules:
                _erase(page, rule)
            out = np.ascontiguousarray(page.T) if turned else page
    return out


def _lines(dark: Grey, faintest: float) -> list[_Rule]:
    """The straight level lines of the page."""
    height, width = dark.shape
    # a rule is thin: what is dark over a long way up and down is none
    thin = dark - cv2.morphologyEx(dark, cv2.MORPH_OPEN, np.ones((max(9, height // 60), 1), np.uint8))
    mask = (thin > faintest) & (cv2.blur(dark, (max(15, width // 25), 1)) > 0.6 * faintest)
    if not 0.002 < mask.mean() < 0.5:
        return []
    turn = np.radians(MOST_TURN_DEG)
    found = cv2.HoughLines(
        mask.astype(np.uint8), 1.5, np.radians(0.25), round(0.7 * SPAN * width),
        min_theta=np.pi / 2 - turn, max_theta=np.pi / 2 + turn,
    )  # fmt: skip
    if found is None:
        return []
    rules: list[_Rule] = []
    thirds = np.array([width / 3, 2 * width / 3])
    misses, taken = 0, np.zeros((0, 2))  # heights of the rules at the thirds of the page
    columns = np.arange(width)
    beside = cv2.dilate(mask.astype(np.uint8), np.ones((2 * _REACH + 1, 1), np.uint8))
    for rho, theta in found[:MOST_LINES, 0, :2].tolist():
        a, b = rho / np.sin(theta), -1.0 / np.tan(theta)
        if (np.abs(a + b * thirds - taken).max(1) > 3.0).all():
            # the fit looks no farther up and down than that: where too little is beside the line, it is spared
            rows = np.clip(np.round(a + b * columns).astype(int), 0, height - 1)
            seen = beside[rows, columns].sum() >= SPAN * width
            fitted = _fitted(mask, dark, a, b) if seen else None
            if fitted is None:
                misses += 1
                if misses > MOST_MISSES:
                    break
                continue
            at = fitted.a + fitted.b * thirds
            if (np.abs(at - taken).max(1) > 4.0).all():
                rules.append(fitted)
                taken = np.vstack([taken, at])
                _take(mask, fitted)  # what this one stands on speaks for no other
            if len(rules) > MOST_RULES:  # no paper has so many: it is noise
                return []
    return rules


def _take(mask: Bool[np.ndarray, "H W"], rule: _Rule) -> None:
    columns = np.arange(mask.shape[1])
    reach = int(np.ceil(rule.half)) + 1
    rows = np.round(rule.a + rule.b * columns).astype(int)[:, None] + np.arange(-reach, reach + 1)
    mask[np.clip(rows, 0, mask.shape[0] - 1), columns[:, None]] = False


def _fitted(mask: Bool[np.ndarray, "H W"], dark: Grey, a: float, b: float) -> _Rule | None:
    """The line fitted to the pixels beside it; None when too few columns have one."""
    height, width = mask.shape
    columns = np.arange(width)
    reach = np.arange(-_REACH, _REACH + 1)
    for spread in (5.0, 3.0, 2.0):
        centre = a + b * columns
        rows = np.clip(np.round(centre).astype(int)[:, None] + reach, 0, height - 1)
        near = mask[rows, columns[:, None]] & (np.abs(rows - centre[:, None]) <= spread)
        if near.any(1).sum() < SPAN * width:
            return None
        x, y = np.broadcast_to(columns[:, None], rows.shape)[near], rows[near]
        b, a = np.polyfit(x, y, 1)
    counts = near.sum(1)
    at = np.clip(np.round(a + b * columns).astype(int), 0, height - 1)
    half = 0.5 * float(np.median(counts[counts > 0]))
    return _Rule(
        float(a), float(b), half, float(np.median(dark[at, columns][near.any(1)])), float(near.any(1).mean())
    )


def _family(rules: list[_Rule], width: int) -> list[_Rule]:
    """The rules that lie beside each other at about even distances, all of about one darkness and slope."""
    rules = sorted(rules, key=lambda r: r.a + r.b * width / 2)
    if rules:  # seen at a slant, their slopes change slowly from rule to rule
        slopes = np.array([r.b for r in rules])
        beside = [float(np.median(slopes[max(0, k - 3) : k + 4])) for k in range(len(rules))]
        rules = [r for r, usual in zip(rules, beside, strict=True) if abs(r.b - usual) < 0.012]
    if len(rules) < FAMILY:
        return []
    at = np.array([r.a + r.b * width / 2 for r in rules])
    step = float(np.median(np.diff(at)))
    even = np.abs(np.diff(at) / step - np.round(np.diff(at) / step)) < 0.2
    usual = np.median([r.dark for r in rules])
    if step < 8 or even.mean() < 0.7:
        return []
    return [r for r in rules if r.dark < DARKER * usual]


def _erase(page: Grey, rule: _Rule) -> None:
    """The rule out of the page; where ink goes on above and below it, it goes on across it."""
    height, width = page.shape
    columns = np.arange(width)
    centre = rule.a + rule.b * columns
    reach = int(np.ceil(rule.half + 1.0))
    band = np.round(centre).astype(int)[:, None] + np.arange(-reach, reach + 1)
    ends = np.stack([band[:, 0] - 1, band[:, -1] + 1], 1)
    inside = (ends >= 0).all(1) & (ends < height).all(1)
    band, ends, columns = band[inside], ends[inside], columns[inside]
    values = page[band, columns[:, None]]
    around: Float64[np.ndarray, "N 2"] = page[ends, columns[:, None]].astype(np.float64)
    # what a stroke's darkness is above and below, looked for a little to both sides as it may cross at a slant
    above, below = (np.maximum.reduce([np.roll(around[:, k], s) for s in range(-3, 4)]) for k in (0, 1))
    through = np.minimum(above, below)
    local = np.minimum(rule.dark, np.maximum(values, 0.0))
    left = np.where(values > DARKER * rule.dark, values, np.maximum(values - local, 0.0))
    ink = through > max(0.5 * rule.dark, 0.04)
    left = np.where(ink[:, None], np.maximum(left, np.minimum(values, through[:, None])), left)
    page[band, columns[:, None]] = left.astype(page.dtype)
