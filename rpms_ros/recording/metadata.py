"""metadata.yaml, the table of contents of a recording (version 9 of rosbag2)."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from rpms_ros.recording.records import Channel

VERSION = 9
_NO_TIME = 2**63 - 1


@dataclass(frozen=True)
class TopicEntry:
    """A topic that was written.

    Attributes
    ----------
    channel : Channel
        Its name and type.
    digest : str
        Hash of the type.
    count : int
        Number of messages.
    """

    channel: Channel
    digest: str
    count: int


def metadata_of(
    file_name: str,
    storage: str,
    topics: Sequence[TopicEntry],
    span_ns: tuple[int, int] | None,
    custom: Mapping[str, str],
) -> dict[str, Any]:
    """Return the metadata of a recording with one file.

    Parameters
    ----------
    file_name : str
        Name of the storage file.
    storage : str
        ``mcap`` or ``sqlite3``.
    topics : sequence of TopicEntry
        All topics.
    span_ns : tuple of int, optional
        First and last time of reception [ns]; None without messages.
    custom : mapping of str to str
        Notes for people.
    """
    first, last = span_ns or (_NO_TIME, _NO_TIME)
    span = {
        'starting_time': {'nanoseconds_since_epoch': first},
        'duration': {'nanoseconds': last - first},
        'message_count': sum(topic.count for topic in topics),
    }
    return {
        'version': VERSION,
        'storage_identifier': storage,
        'relative_file_paths': [file_name],
        **span,
        'topics_with_message_count': [_topic(topic) for topic in topics],
        'compression_format': '',
        'compression_mode': '',
        'files': [{'path': file_name, **span}],
        'custom_data': dict(custom) or None,
        'ros_distro': 'jazzy',
    }


def _topic(topic: TopicEntry) -> dict[str, Any]:
    return {
        'topic_metadata': {
            'name': topic.channel.topic,
            'type': topic.channel.type_name,
            'serialization_format': topic.channel.serialization,
            'offered_qos_profiles': [],
            'type_description_hash': topic.digest,
        },
        'message_count': topic.count,
    }


def as_yaml(document: Mapping[str, Any]) -> str:
    """Return a document as rosbag2 writes it."""
    return yaml.safe_dump(dict(document), sort_keys=False, allow_unicode=True)
