"""Recordings written: raw messages as they come, or arrays at once."""

from collections.abc import Mapping
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from sqlite3 import Error as SqliteError
from types import TracebackType

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import PulseTrain
from rpms_ros.recording.axis import direction_of
from rpms_ros.recording.batches import Batch
from rpms_ros.recording.batches import merged
from rpms_ros.recording.compression import COMPRESSORS
from rpms_ros.recording.definitions import PULSE
from rpms_ros.recording.definitions import WRENCH_STAMPED
from rpms_ros.recording.definitions import written_definition
from rpms_ros.recording.encoding import encode_forces
from rpms_ros.recording.encoding import encode_pulses
from rpms_ros.recording.files import METADATA_KEY
from rpms_ros.recording.files import METADATA_NAME
from rpms_ros.recording.mcap_writing import McapFileWriter
from rpms_ros.recording.metadata import TopicEntry
from rpms_ros.recording.metadata import as_yaml
from rpms_ros.recording.metadata import metadata_of
from rpms_ros.recording.records import Channel
from rpms_ros.recording.records import Records
from rpms_ros.recording.sqlite_writing import SqliteFileWriter

STORAGES: dict[str, type[McapFileWriter] | type[SqliteFileWriter]] = {
    'mcap': McapFileWriter,
    'sqlite3': SqliteFileWriter,
}
PULSES_TOPIC = '/pulses'
FORCE_TOPIC = '/force'
PULSE_FRAME = 'coil'
# About a megabyte of force samples: one chunk of mcap, one transaction of sqlite3.
_MESSAGES_PER_WRITE = 8192


class RecordingWriter:
    """A recording that is being written: a folder with a storage file and metadata.yaml.

    Every `flush` and `write` hands its messages to the operating system: a process that is killed
    afterwards leaves them readable.

    Parameters
    ----------
    path : Path or str
        Folder that does not exist yet.
    storage : str
        ``mcap`` or ``sqlite3``.
    compression : str
        Of the chunks of mcap: empty, ``lz4`` or ``zstd``.
    custom : mapping of str to str, optional
        Notes for people, kept in metadata.yaml.

    Raises
    ------
    RecordingError
        If the folder exists or cannot be made.
    """

    def __init__(
        self,
        path: Path | str,
        storage: str = 'mcap',
        compression: str = '',
        custom: Mapping[str, str] | None = None,
    ) -> None:
        self.path = Path(path)
        self._storage = storage
        self._custom = custom or {}
        self._topics: list[tuple[Channel, str]] = []
        self._counts: list[int] = []
        self._span_ns: tuple[int, int] | None = None
        self._pending: tuple[list[int], list[int], list[bytes]] = ([], [], [])
        if storage not in STORAGES:
            raise RecordingError(f'expected storage {" or ".join(STORAGES)}, got {storage!r}')
        if compression not in (COMPRESSORS if storage == 'mcap' else ('',)):
            raise RecordingError(
                f'expected compression lz4 or zstd of mcap, got {compression!r} of {storage}'
            )
        if self.path.exists():
            raise RecordingError(f'expected a new folder for the recording, got {path}')
        self._file_path = self.path / f'{self.path.name}_0{STORAGES[storage].suffix}'
        try:
            self.path.mkdir(parents=True)
            self._file = STORAGES[storage](self._file_path, compression)
        except (OSError, SqliteError) as error:
            raise self._refused(error) from error

    def add_topic(self, name: str, type_name: str) -> int:
        """Return the number of a new topic, for `append` and `write`."""
        text, digest = written_definition(type_name)
        channel = Channel(name, type_name, text)
        try:
            number = self._file.add_channel(channel, digest)
        except (OSError, SqliteError) as error:
            raise self._refused(error) from error
        self._topics.append((channel, digest))
        self._counts.append(0)
        return number

    def append(self, topic: int, time_ns: int, message: bytes) -> None:
        """Take one message, received at `time_ns`; it is written with the next `flush`."""
        for values, value in zip(self._pending, (topic, time_ns, message), strict=True):
            values.append(value)  # type: ignore[attr-defined]

    def flush(self) -> None:
        """Write the messages that were appended."""
        (topics, times, messages), self._pending = self._pending, ([], [], [])
        if topics:
            records = Records.of(messages, np.array(times, np.int64))
            self.write(Batch(np.array(topics, np.int64), records))

    def write(self, batch: Batch) -> None:
        """Write messages at once.

        Raises
        ------
        RecordingError
            If the device refuses them, for instance because it is full.
        """
        for begin in range(0, len(batch), _MESSAGES_PER_WRITE):
            self._write(batch.part(begin, begin + _MESSAGES_PER_WRITE))

    def _write(self, batch: Batch) -> None:
        try:
            self._file.write(batch)
        except (OSError, SqliteError) as error:
            raise self._refused(error) from error
        for number, count in zip(*np.unique(batch.topic, return_counts=True), strict=True):
            self._counts[number - 1] += int(count)
        first, last = int(batch.records.time_ns.min()), int(batch.records.time_ns.max())
        if self._span_ns:
            first, last = min(first, self._span_ns[0]), max(last, self._span_ns[1])
        self._span_ns = first, last

    def close(self) -> None:
        """Write what is left, the index and metadata.yaml."""
        try:
            self.flush()
        finally:
            self._finish()

    def _finish(self) -> None:
        entries = [
            TopicEntry(channel, digest, count)
            for (channel, digest), count in zip(self._topics, self._counts, strict=True)
        ]
        metadata = metadata_of(
            self._file_path.name, self._storage, entries, self._span_ns, self._custom
        )
        try:
            self._file.close(as_yaml(metadata))
            (self.path / METADATA_NAME).write_text(as_yaml({METADATA_KEY: metadata}))
        except (OSError, SqliteError) as error:
            raise self._refused(error) from error

    def _refused(self, error: Exception) -> RecordingError:
        return RecordingError(f'expected room and permission to write {self.path}, got {error}')

    def __enter__(self) -> 'RecordingWriter':
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        _value: BaseException | None,
        _traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
            return
        # What was recorded before the failure is worth an index; the failure is what counts.
        with suppress(RecordingError):
            self.close()


def write_recording(
    path: Path | str,
    pulses: PulseTrain,
    forces: ForceTrace,
    *,
    storage: str = 'mcap',
    compression: str = '',
    axis: str | Sequence[float] = 'z',
    custom: Mapping[str, str] | None = None,
) -> None:
    """Write pulses and forces as a recording.

    They are received at their stamps; pulses come before samples of the same time.

    Parameters
    ----------
    path : Path or str
        Folder that does not exist yet.
    pulses : PulseTrain
        Go to topic ``/pulses``.
    forces : ForceTrace
        Go to topic ``/force``.
    storage, compression, custom
        As in `RecordingWriter`.
    axis : str or sequence of float
        Axis of the force in the frame of the sensor.

    Raises
    ------
    RecordingError
        If the folder exists or the device refuses.
    """
    encoded = {
        (PULSES_TOPIC, PULSE): encode_pulses(pulses, PULSE_FRAME),
        (FORCE_TOPIC, WRENCH_STAMPED): encode_forces(forces, direction_of(axis)),
    }
    with RecordingWriter(path, storage, compression, custom) as writer:
        numbers = {writer.add_topic(*topic): records for topic, records in encoded.items()}
        writer.write(merged(numbers))
