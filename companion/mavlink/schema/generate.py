"""Every file that is generated from the schema, with the text that it is to have."""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Sequence
from pathlib import Path

from pymavlink.generator import mavgen, mavparse

from companion.mavlink.schema.codec import codec
from companion.mavlink.schema.definition import definition
from companion.mavlink.schema.messages import ALIASES, CONSTANTS, ENUMERATIONS, IMPORTS, OWN
from companion.mavlink.schema.rows import Message
from companion.mavlink.schema.stub import stub
from companion.mavlink.schema.values import values

SWARM_XML = "companion/mavlink/swarm.xml"
DIALECT = "companion/mavlink/dialect.py"
CODEC = "companion/mavlink/own_messages.py"
VALUES = "companion/core/model/beacon.py"


def generated(root: Path, messages: Sequence[Message] = OWN) -> dict[str, str]:
    """File, from the root -> text; the same from run to run. Of what stands at `root` only swarm.xml is read."""
    xml = definition((root / SWARM_XML).read_text(encoding="utf-8"), messages, ENUMERATIONS)
    dialect = dialect_of(xml)
    return {
        SWARM_XML: xml,
        DIALECT: dialect,
        f"{DIALECT}i": stub(dialect),
        VALUES: values(messages, ALIASES, IMPORTS),
        CODEC: codec(messages, CONSTANTS, IMPORTS),
    }


def dialect_of(xml: str) -> str:
    """The text that mavgen makes of a definition."""
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder, "swarm.xml"), Path(folder, "dialect")
        source.write_text(xml, encoding="utf-8")
        options = mavgen.Opts(str(out), wire_protocol=mavparse.PROTOCOL_2_0, language="Python3", validate=False)
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            done = mavgen.mavgen(options, [str(source)])
        if not done:
            raise SystemExit(f"mavgen refused swarm.xml:\n{printed.getvalue()}")
        return out.with_suffix(".py").read_text(encoding="utf-8")
