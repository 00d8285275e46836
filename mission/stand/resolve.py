"""The stand of a mission that was read from a file: a fault of its stem map is told where the mission names the map."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from mission.common.problems import MissionError, Problem, shown
from mission.document.load import Document, load_document
from mission.document.model import Mission
from mission.stand.stand import Stand, stand_of

if TYPE_CHECKING:
    from mission.stand.stand import ReadStems


def resolve_stand(
    mission: Mission,
    path: str | os.PathLike[str],
    document: Document | None = None,
    read: ReadStems | None = None,
) -> Stand:
    """`stand_of` with the stem map beside the mission's file `path`. MissionError. `document`: as it is to stand there.

    What is wrong with the map as a whole is told at the line of `forest.file`, with a row of it, at that row.
    """
    try:
        return stand_of(mission, Path(path).parent, read)
    except MissionError as error:
        (problem, *others) = error.problems
        if others or problem.line is not None or problem.key or mission.forest.file is None:
            raise
        _, place, line_of = load_document(path) if document is None else document
        line, named = line_of(("forest", "file")), shown(mission.forest.file)
        raise MissionError([Problem(place, line, "forest.file", named, problem.message)]) from None
