"""Computes the paper's analytic figures and printed numbers again from its equations, and reports on campaigns."""

from ridlink.analysis.printed import Comparison, Verdict, comparisons, excess_distances

__all__ = ["Comparison", "Verdict", "comparisons", "excess_distances"]
