"""Review of recorded traffic: encounters between aircraft, and the alerts of other definitions.

source    the Remote ID of recordings, and the telemetry of vehicles, in the order of time
own       vehicles that are best known by their telemetry
walk      frames to scenes, on the recording's own clock
approach  how near every pair came between two scenes
report    encounters as rows, and the worst of them with their traces
traces    tracks and distances of an encounter in bounded memory
drawing, pictures, page
          the report as one HTML page
whatif    the alerts of other definitions
"""

from ridlink.review.report import Report
from ridlink.review.source import Source, together
from ridlink.review.walk import Walk

__all__ = ["Report", "Source", "Walk", "together"]
