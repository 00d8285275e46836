"""`mission check`: every problem of mission files, and what the good ones fly."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from mission.check.findings import check_document
from mission.check.summary import describe, describe_airtime, summarise
from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE
from mission.common.problems import MissionError, Problem
from mission.document.load import load_document


def run(files: Sequence[str], *, as_json: bool) -> int:
    """Exit code: EXIT_BAD_FILE when one is not good."""
    code = EXIT_DONE
    results: list[dict[str, Any]] = []
    for file in files:
        try:
            result, beyond = _checked(file)
        except MissionError as error:
            code = EXIT_BAD_FILE
            result = {"file": file, "ok": False, "problems": [asdict(problem) for problem in error.problems]}
            if not as_json:
                print(error, file=sys.stderr)
        else:
            if not as_json:
                print(describe(result))
                print(f"  {describe_airtime(result)}")
                for problem in beyond:
                    print(f"  not for the simulator: {problem}")
                for note in result["notes"]:
                    print(f"  {note}")
        results.append(result)
    if as_json:
        print(json.dumps(results, indent=2))
    return code


def _checked(file: str) -> tuple[dict[str, Any], tuple[Problem, ...]]:
    """Reads `file`, and finds what the simulated vehicles cannot fly of it: without [origin] it is for them alone."""
    found = check_document(load_document(file), file)
    told = {"beyond_simulator": [asdict(problem) for problem in found.beyond], "notes": list(found.notes)}
    return summarise(file, found.mission) | told, found.beyond
