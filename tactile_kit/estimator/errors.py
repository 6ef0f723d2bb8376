"""Errors of the estimator and of its coupling with the policy."""

from __future__ import annotations


class EstimatorError(ValueError):
    """Input that the estimator can't take: wrong shape, value out of range, or state that doesn't fit the network."""
