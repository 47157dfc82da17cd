"""The engine: one own-ship and its goal, datagrams in, setpoints out, without input or output of its own."""

from ridlink.engine.config import EngineConfig, Goal
from ridlink.engine.core import Engine, EngineSummary, StepOutput
from ridlink.engine.decision import Conflict, DecisionRecord

__all__ = ["Conflict", "DecisionRecord", "Engine", "EngineConfig", "EngineSummary", "Goal", "StepOutput"]
