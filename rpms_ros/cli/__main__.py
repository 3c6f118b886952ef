"""``python -m rpms_ros.cli``."""

import sys

from rpms_ros.cli import main

if __name__ == '__main__':
    sys.exit(main())
