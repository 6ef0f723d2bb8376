"""What can't be shown."""

from __future__ import annotations


class ViewError(ValueError):
    """An episode or a view that can't be made; the message names what was asked for and what is allowed."""
