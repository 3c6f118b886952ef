# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""metadata.yaml, the table of contents of a recording (version 9 of rosbag2)."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import yaml
from rosbags.interfaces import Qos
from rosbags.rosbag2.metadata import dump_qos_v9

from rpms_ros.recording.records import Channel

VERSION = 9
NAME = 'metadata.yaml'
KEY = 'rosbag2_bagfile_information'
CRC_KEY = 'storage_crc32'
"""Name in `custom_data` under which the CRC-32 of a sqlite3 file stands."""
_NO_TIME = 2**63 - 1


@dataclass
class TopicEntry:
    """A topic that is written.

    Attributes
    ----------
    channel : Channel
        Its name and type.
    digest : str
        Hash of the type.
    qos : sequence of Qos
        Quality of service that its publishers offer.
    count : int
        Number of messages so far.
    """

    channel: Channel
    digest: str
    qos: Sequence[Qos] = ()
    count: int = 0


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
        What was written.
    span_ns : (int, int) or None
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
        'topics_with_message_count': _topics(topics),
        'compression_format': '',
        'compression_mode': '',
        'files': [{'path': file_name, **span}],
        'custom_data': dict(custom) or None,
        'ros_distro': 'jazzy',
    }


def _topics(topics: Sequence[TopicEntry]) -> list[dict[str, Any]]:
    """Return one entry a topic and type, however many publishers it has."""
    counts: dict[tuple[str, str], int] = {}
    first: dict[tuple[str, str], TopicEntry] = {}
    for topic in topics:
        key = topic.channel.topic, topic.channel.type_name
        first.setdefault(key, topic)
        counts[key] = counts.get(key, 0) + topic.count
    return [_topic(topic, counts[key]) for key, topic in first.items()]


def _topic(topic: TopicEntry, count: int) -> dict[str, Any]:
    return {
        'topic_metadata': {
            'name': topic.channel.topic,
            'type': topic.channel.type_name,
            'serialization_format': topic.channel.serialization,
            'offered_qos_profiles': dump_qos_v9(list(topic.qos)),
            'type_description_hash': topic.digest,
        },
        'message_count': count,
    }


def qos_text(qos: Sequence[Qos]) -> str:
    """Return profiles as rosbag2 writes them into a storage file."""
    return as_yaml(dump_qos_v9(list(qos))) if qos else ''


def as_yaml(document: object) -> str:
    """Return a document as rosbag2 writes it."""
    return yaml.dump(document, Dumper=_Dumper, sort_keys=False, allow_unicode=True)


class _Dumper(yaml.SafeDumper):
    """Writes what stands in two places twice, not once and a reference to it."""

    def ignore_aliases(self, _data: object) -> bool:
        return True
