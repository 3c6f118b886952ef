"""Exact variable projection on sums that are kept a pulse, not on samples."""
