"""On-line identification of magnetically or electrically stimulated muscle."""

__version__ = '0.1.0'
