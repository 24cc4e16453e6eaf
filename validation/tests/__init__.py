"""Tests of the package ``phipsi`` and of the comparisons: ``python -m pytest validation`` from the repository root."""
