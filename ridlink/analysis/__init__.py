"""The paper's analytic figures and printed numbers, computed again from its own equations."""

from ridlink.analysis.printed import Comparison, Verdict, comparisons, excess_distances

__all__ = ["Comparison", "Verdict", "comparisons", "excess_distances"]
