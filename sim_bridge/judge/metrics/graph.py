"""The graph G of a recorded flight: is the swarm one, and how well is it connected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_bridge.judge.metrics.arrays import Bools, Floats
from sim_bridge.judge.metrics.pairs import Pairs
from sim_bridge.judge.recording import Recording


def connectivity(recording: Recording, pairs: Pairs, wanted: Bools) -> tuple[Bools, Floats]:
    """(T,) all alive vehicles are one component; (T,) lambda2, nan where not `wanted` (T,) or below two alive."""
    ticks, n = recording.agent_alive.shape
    connected = np.zeros(ticks, dtype=np.bool_)
    lambda2 = np.full(ticks, np.nan)
    if ticks == 0:
        return connected, lambda2
    # Links change far less often than ticks pass: each graph is worked out once
    bits = np.packbits(np.hstack((recording.agent_alive, pairs.links)), axis=1)
    examples, graph = _distinct(bits)
    graph_wanted = np.bincount(graph, weights=wanted) > 0
    adjacency = np.zeros((n, n), dtype=np.bool_)
    graph_connected = np.zeros(len(examples), dtype=np.bool_)
    graph_lambda2 = np.full(len(examples), np.nan)
    for g, tick in enumerate(examples):
        adjacency[pairs.first, pairs.second] = adjacency[pairs.second, pairs.first] = pairs.links[tick]
        alive = np.flatnonzero(recording.agent_alive[tick])
        among_alive = adjacency[np.ix_(alive, alive)]
        graph_connected[g] = _is_connected(among_alive)
        if graph_wanted[g] and len(alive) > 1:
            laplacian = np.diag(among_alive.sum(axis=1)) - among_alive.astype(np.float64)
            graph_lambda2[g] = max(0.0, np.linalg.eigvalsh(laplacian)[1]) if graph_connected[g] else 0.0
    return graph_connected[graph], np.where(wanted, graph_lambda2[graph], np.nan)


def _distinct(rows: NDArray[np.bool_ | np.uint8]) -> tuple[list[int], NDArray[np.intp]]:
    """First index of each distinct row, and every row's number among these. `np.unique` would import masked arrays."""
    seen: dict[bytes, int] = {}
    which = np.array([seen.setdefault(row.tobytes(), len(seen)) for row in rows], dtype=np.intp)
    first = np.full(len(seen), len(rows))
    np.minimum.at(first, which, np.arange(len(rows)))
    return first.tolist(), which


def leaders_together(recording: Recording, heard: Pairs) -> Bools:
    """(T,) two acting leaders are in one component of G; `heard`: without the links that faults cut."""
    acting = recording.acting & recording.agent_alive
    together = np.zeros(len(acting), dtype=np.bool_)
    n = acting.shape[1]
    for tick in np.flatnonzero(acting.sum(axis=1) > 1).tolist():
        adjacency = np.zeros((n, n), dtype=np.bool_)
        adjacency[heard.first, heard.second] = adjacency[heard.second, heard.first] = heard.links[tick]
        leaders = np.flatnonzero(acting[tick]).tolist()
        together[tick] = any(_reached(adjacency, one)[leaders].sum() > 1 for one in leaders[:-1])
    return together


def _reached(adjacency: Bools, start: int) -> Bools:
    """(n,) the component of `start` in a graph (n, n)."""
    reached = np.zeros(len(adjacency), dtype=np.bool_)
    newly = reached.copy()
    newly[start : start + 1] = True
    while newly.any():
        reached |= newly
        newly = adjacency[newly].any(axis=0) & ~reached
    return reached


@dataclass(frozen=True, slots=True)
class Partings:
    """Count and durations of the swarm's network partitions."""

    count: int
    longest_s: float
    rejoined_s: float | None  # the longest that ended


def partings(time_s: Floats, connected: Bools, wanted: Bools) -> Partings:
    """Of the ticks that are `wanted` (T,), from each that is not `connected` (T,) to the next that is.

    A partition lasts until the swarm is one again, whatever the phase is by then.
    """
    apart = np.concatenate((wanted & ~connected, [False]))
    count, longest_s, rejoined_s, tick = 0, 0.0, -np.inf, 0
    while (tick := tick + int(apart[tick:].argmax())) < len(time_s) and apart[tick]:
        rest = np.flatnonzero(connected[tick:])
        end = tick + int(rest[0]) if rest.size else len(time_s) - 1
        lasted_s = float(time_s[end] - time_s[tick])
        count, longest_s = count + 1, max(longest_s, lasted_s)
        if not rest.size:
            break
        rejoined_s, tick = max(rejoined_s, lasted_s), end
    return Partings(count, longest_s, float(rejoined_s) if np.isfinite(rejoined_s) else None)


def _is_connected(adjacency: Bools) -> bool:
    """True for a graph (n, n) of one component; without vertices it is none."""
    reached = _reached(adjacency, 0)
    return bool(reached.size and reached.all())


def least_vertex_connectivity(recording: Recording, pairs: Pairs, wanted: Bools) -> int | None:
    """The least over the ticks that are `wanted` (T,) and have two alive vehicles or more; None: there are none."""
    n = recording.agent_alive.shape[1]
    found = []
    graphs = np.hstack((recording.agent_alive, pairs.links))[wanted]
    for graph in graphs[_distinct(graphs)[0]]:
        alive = np.flatnonzero(graph[:n])
        adjacency = np.zeros((n, n), dtype=np.bool_)
        adjacency[pairs.first, pairs.second] = adjacency[pairs.second, pairs.first] = graph[n:]
        if len(alive) > 1:
            found.append(vertex_connectivity(adjacency[np.ix_(alive, alive)]))
    return min(found, default=None)


def vertex_connectivity(adjacency: Bools) -> int:
    """Least number of vertices to remove until the rest of a graph (n, n) is not one component; n - 1: none do that.

    By Menger's theorem the least number of paths, without a common vertex, between two that are not linked. Of any
    k + 1 vertices one stays when k go: it is enough to begin at so many (S. Even, 1975).
    """
    n = len(adjacency)
    linked = [sum(1 << int(other) for other in np.flatnonzero(row)) for row in adjacency]  # bits of vertices
    # Each vertex is an entrance, v, and an exit, n + v, with room for one path between them.
    network = [*(1 << n + v for v in range(n)), *linked]
    k = min(n - 1, int(adjacency.sum(axis=1).min(initial=n)))
    first = 0
    while first <= k < n - 1:
        for other in range(n):
            linked_by_one = (linked[first] & linked[other]).bit_count()  # each such vertex is a path
            if other != first and linked_by_one < k and not linked[first] >> other & 1:
                k = min(k, _paths(network, n + first, other, enough=k))
        first += 1
    return max(0, k)


def _paths(network: list[int], start: int, end: int, *, enough: int) -> int:
    """Count of edge-disjoint paths from `start` to `end`, to `enough`; `network`: each node's successors as bits."""
    room = list(network)  # edges that no path takes, and those back along a path
    for count in range(enough):
        before, reached, queue = {}, 1 << start, [start]
        for node in queue:
            fresh = room[node] & ~reached
            reached |= fresh
            while fresh:
                after = fresh.bit_length() - 1
                fresh ^= 1 << after
                before[after] = node
                queue.append(after)
        if end not in before:
            return count
        node = end
        while node != start:
            room[before[node]] ^= 1 << node
            room[node] |= 1 << before[node]
            node = before[node]
    return enough
