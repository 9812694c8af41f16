"""What a bag should hold, by what it says of itself: counted, not believed."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

import yaml

from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.topics import MEASUREMENT, NAMESPACE, SCALAR_TOPICS, WAY_TO_REST_TOPICS

#: Topics whose messages are the signals of a record.
SIGNAL_TOPICS = (*SCALAR_TOPICS, MEASUREMENT)

#: The same with the way to rest, which a bag may lack.
READ_TOPICS = (*SIGNAL_TOPICS, *WAY_TO_REST_TOPICS)

#: Largest `metadata.yaml` that is read [characters].
MAX_METADATA = 10_000_000

#: How many topics a message lists.
_LISTED = 8


def namespace_of(recorded: Collection[str]) -> str:
    """Return the namespace the signals of a bag were recorded under, ``"/rths"`` where there are none.

    Parameters
    ----------
    recorded : collection of str
        Names of the topics that have messages.

    Raises
    ------
    InputError
        Several namespaces have signals, or there are topics and none of them is a signal.
    """
    signals = {topic.name for topic in READ_TOPICS}
    found: dict[str, set[str]] = {}
    for place, _, name in (topic.rpartition("/") for topic in recorded):
        if name in signals:
            found.setdefault(place, set()).add(name)
    if found:
        best = max(found, key=lambda place: len(found[place]))
        # One topic that the test has too is of somebody else: a robot has a command as well.
        others = {place for place, names in found.items() if len(names) > 1 or not names <= found[best]} - {best}
        if others:
            raise InputError(f"signals in {1 + len(others)} namespaces, {_listed({best, *others})}; one is required")
        return best
    foreign = [name for name in recorded if name not in ("/diagnostics", "/rosout", "/parameter_events")]
    if foreign:
        raise InputError(f"no signal of a test in it; topics found: {_listed(foreign)}")
    return NAMESPACE


def promised_counts(metadata: str) -> dict[str, int]:
    """Return how many messages of each topic a ``metadata.yaml`` promises; none where it cannot be read.

    Parameters
    ----------
    metadata : str
        Its text, or the copy of it in the MCAP file.
    """
    information = _information(metadata)
    counts: dict[str, int] = {}
    topics = information.get("topics_with_message_count")
    for entry in topics if isinstance(topics, list) else ():
        try:
            name, count = entry["topic_metadata"]["name"], entry["message_count"]
        except (KeyError, TypeError):
            continue
        if isinstance(name, str) and isinstance(count, int):
            counts[name] = count
    return counts


def promised_files(metadata: str) -> list[str]:
    """Return the names of the files a ``metadata.yaml`` lists; none where it cannot be read.

    Parameters
    ----------
    metadata : str
        Its text.
    """
    files = _information(metadata).get("relative_file_paths")
    return [name for name in files if isinstance(name, str)] if isinstance(files, list) else []


def shortfall(promised: Mapping[str, int], counted: Mapping[str, int]) -> str:
    """Return which messages of signals are missing, "" when none is.

    Parameters
    ----------
    promised : Mapping
        Messages by topic, as metadata have them.
    counted : Mapping
        Messages by topic that were found.
    """
    total = missing = 0
    for topic in READ_TOPICS:  # in any namespace: a tool that renames topics leaves the metadata as they were
        wanted = max((count for name, count in promised.items() if name.endswith(f"/{topic.name}")), default=0)
        there = max((count for name, count in counted.items() if name.endswith(f"/{topic.name}")), default=0)
        total, missing = total + wanted, missing + max(0, wanted - there)
    return f"{missing} of {total} messages of signals, as its metadata count them, are missing" if missing else ""


def _information(metadata: str) -> dict[str, Any]:
    try:
        content = yaml.load(metadata, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        information = content.get("rosbag2_bagfile_information", content)
    except (yaml.YAMLError, AttributeError, ValueError, RecursionError):
        return {}
    return information if isinstance(information, dict) else {}


def _listed(names: Iterable[str]) -> str:
    found = sorted(names)
    rest = f" and {len(found) - _LISTED} more" if len(found) > _LISTED else ""
    return ", ".join(repr(name[:60]) for name in found[:_LISTED]) + rest
