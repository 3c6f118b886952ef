"""Text from anybody, on one line of a terminal."""


def printable(text: str) -> str:
    """Return text in which nothing moves the cursor or breaks the line of a terminal."""
    return ''.join(
        char if char.isprintable() else char.encode('unicode_escape', 'replace').decode()
        for char in text
    )
