"""Build hook: runs mavgen on message_spec/ridlink.xml, so that no generated code is ever committed."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class DialectBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Writes ridlink/mavlink/dialect.py for wheels and editable installs; an sdist carries the XML alone."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if self.target_name == "sdist":
            return
        root = Path(self.root)
        spec = importlib.util.spec_from_file_location("message_spec_generate", root / "message_spec" / "generate.py")
        assert spec is not None and spec.loader is not None
        generate = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(generate)
        generate.generate("python", root / "ridlink" / "mavlink" / "dialect.py")
        build_data["artifacts"].append("ridlink/mavlink/dialect.py")
