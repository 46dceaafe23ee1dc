"""``python -m benchmarks.slip_ablation``."""

import sys

from benchmarks.slip_ablation.run import main

if __name__ == '__main__':
    sys.exit(main())
