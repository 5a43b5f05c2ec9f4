"""`python -m glassgait.models.certificates.checker certificate.json`."""

import argparse
import sys
from pathlib import Path

from . import RefusedError, __doc__, check


def main() -> None:
    """Checks the certificate that the command line names."""
    reader = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    reader.add_argument("certificate", type=Path)
    reader.add_argument("--policy", type=Path, help="the policy's file; the shipped one by default")
    reader.add_argument("--gait", type=Path, help="the gait's file; the shipped one by default")
    reader.add_argument("--robot", type=Path, help="the robot's file; the shipped one by default")
    options = reader.parse_args()
    try:
        print(check(options.certificate, options.policy, options.gait, options.robot))
    except RefusedError as refusal:
        sys.exit(f"{options.certificate}: {refusal}")


if __name__ == "__main__":
    main()
