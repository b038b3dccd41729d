"""``python -m gcs.child PARENT MODULE ...``: run a module that ends when the process PARENT ends, however that ends.

The supervisor starts everything through this, so that a station leaves no process behind even if it is killed.
"""

from __future__ import annotations

import os
import runpy
import sys

from gcs.runtime import end_with_parent


def main() -> None:
    """Tie this process to its parent, then become the module."""
    parent, module = int(sys.argv[1]), sys.argv[2]
    end_with_parent()
    if os.getppid() != parent:
        return  # The parent ended before the kernel knew of our wish.
    sys.argv = [module, *sys.argv[3:]]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
