"""A worker starts deaf to Ctrl-C, the first one too."""

import subprocess
import sys

PROGRAM = """
import signal
from multiprocessing import resource_tracker
from jenga_data.pool import interrupts_held
def main():
    assert resource_tracker._resource_tracker._fd is None
    with interrupts_held():
        resource_tracker.ensure_running()  # as the first queue does
        assert signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
main()
"""


def test_the_tracker_of_resources_does_not_let_ctrl_c_through():
    subprocess.run([sys.executable, "-c", PROGRAM], check=True, timeout=60)
