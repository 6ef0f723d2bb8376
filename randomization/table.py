"""The documentation's tables of all terms and presets: ``python -m randomization.table FILE``."""

from __future__ import annotations

import sys
from pathlib import Path

from randomization.files import PRESETS, preset
from randomization.sampling import Term

HEAD = """\
# Randomisation

<!-- Made from the data by `make docs`; edit randomization/data/ instead. -->

What is randomised, how far, and when. Each term reads its own named random stream of the episode's seed, so
changing one leaves the numbers of the others as they were. The drawn values of an episode are in
`info["randomization"]`; `randomization.preset(NAME).replay(values)` brings them back.

`U(a, b)` is uniform, `logU(a, b)` uniform in the logarithm, `N(m, s)` Gaussian with standard deviation `s`.
Three numbers in brackets stand for the joints q1, q2, q3 of each finger.
"""

TAIL = """\
## Own randomisation

A file names the preset it starts from and the terms it replaces; unknown keys and values out of range are
refused.

```yaml
summary: A slippery hand.
extends: default
terms:
  tip_friction: {distribution: uniform, low: 0.3, high: 0.6, source: measured on our fingertips}
  force: {distribution: direction, magnitude: {distribution: uniform, low: 0, high: 0.1}}
```

`randomization.preset("own.yaml")` loads it. Distributions: `constant` (value), `uniform` and `log_uniform`
(low, high), `normal` (mean, std), `bernoulli` (probability), `direction` (magnitude; a number or a
distribution).
"""


def page() -> str:
    """The whole page as Markdown, ending in a newline."""
    presets = [preset(name) for name in PRESETS]
    terms = list(presets[0].terms)
    ranges = [["term", "unit", "drawn", "allowed", *PRESETS]]
    sources = [["term", "meaning", *(f"source of `{name}`" for name in PRESETS)]]
    for name in terms:
        variants = [randomization.terms[name] for randomization in presets]
        texts = _unchanged_as_ditto([term.distribution.describe() for term in variants])
        first = variants[0]
        low, high = first.allowed
        ranges.append([_label(first), first.unit, _when(first.when), f"{low:g} to {high:g}", *texts])
        sources.append([f"`{name}`", first.meaning, *_unchanged_as_ditto([term.source for term in variants])])
    summaries = "\n".join(f"- `{item.name}`: {item.summary}" for item in presets)
    presets_part = f"## Presets\n\n{summaries}\n\n{_markdown(ranges)}\n"
    return "\n".join([HEAD, presets_part, f"## Meaning and sources\n\n{_markdown(sources)}\n", TAIL])


def _label(term: Term) -> str:
    return f"`{term.name}`" + (f" ({term.size})" if term.size > 1 else "")


def _when(when: str) -> str:
    return f"every {when.split(':')[1]} s" if ":" in when else f"each {when}"


def _unchanged_as_ditto(texts: list[str]) -> list[str]:
    """An entry equal to the one before shows as '=': what a preset changes stands out."""
    return [text if i == 0 or text != texts[i - 1] else "=" for i, text in enumerate(texts)]


def _markdown(rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    lines.insert(1, "|" + "---|" * len(rows[0]))
    return "\n".join(lines)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python -m randomization.table FILE")
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
