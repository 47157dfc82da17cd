"""How a configuration says that a link is signed, and the key that it names."""

from __future__ import annotations

import contextlib
import os
import shlex
import stat
from dataclasses import dataclass
from pathlib import Path

from ridlink.errors import ConfigError
from ridlink.mavlink.signing import KEY_LENGTH
from ridlink.ranges import Range

LINK_ID_RANGE = Range(0, 255)


@dataclass(frozen=True, slots=True)
class SigningOptions:
    """How a link is signed.

    Args:
        key_file: File with 32 bytes, or 64 hexadecimal digits, that only its owner can read.
        required: Refuse what is not signed.
        link_id: Link id of our own signatures; each link of a component needs its own.
        state_file: File of the clock; None: beside the key, with `.state` after its name.
    """

    key_file: Path
    required: bool = False
    link_id: int = 0
    state_file: Path | None = None

    @classmethod
    def of(
        cls,
        signing_key: str | None,
        require_signature: bool | None = None,
        signing_link_id: int | None = None,
        signing_state: str | None = None,
    ) -> SigningOptions | None:
        """Options from the keys of a configuration; None if the link is not signed.

        Raises:
            ConfigError: If the keys contradict each other.
        """
        if signing_key is None:
            if require_signature or signing_state is not None or signing_link_id is not None:
                raise ConfigError("require-signature, signing-link-id and signing-state need a key: give signing-key")
            return None
        link_id = signing_link_id or 0
        LINK_ID_RANGE.check("signing-link-id", link_id)
        state = None if signing_state is None else Path(signing_state)
        return cls(Path(signing_key), bool(require_signature), link_id, state)

    @property
    def state(self) -> Path:
        """File of the clock."""
        return self.key_file.with_name(self.key_file.name + ".state") if self.state_file is None else self.state_file


def read_key(path: Path) -> bytes:
    """The key in a file.

    Raises:
        ConfigError: If others can read the file, or it is no key.
        OSError: If it cannot be read.
    """
    make = f"make one with (umask 077; head -c {KEY_LENGTH} /dev/urandom > {shlex.quote(str(path))})"
    try:
        file = path.open("rb")
    except FileNotFoundError as error:
        raise FileNotFoundError(error.errno, f"no such signing key; {make}", str(path)) from error
    with file:
        status = os.fstat(file.fileno())  # status of the open file, not of what the name pointed to earlier
        if not stat.S_ISREG(status.st_mode) or stat.S_IMODE(status.st_mode) not in (0o600, 0o400):
            raise ConfigError(f"{path}: a signing key must be a file of mode 0600; chmod 600 {path}")
        if status.st_uid not in (os.geteuid(), 0):
            raise ConfigError(f"{path}: a signing key must belong to who uses it; chown it")
        content = file.read(4 * KEY_LENGTH)
    if len(content) == KEY_LENGTH:
        return content
    with contextlib.suppress(ValueError):
        if len(key := bytes.fromhex(content.decode("ascii", "replace").strip())) == KEY_LENGTH:
            return key
    raise ConfigError(f"{path}: a signing key has {KEY_LENGTH} bytes or {2 * KEY_LENGTH} hexadecimal digits; {make}")
