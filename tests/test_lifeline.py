"""Child processes end with their parent, also one that is killed."""

import subprocess
import sys

CHILD = "from ciphernav_jax.lifeline import end_with_parent; end_with_parent(); print('on', flush=True)"
PARENT = f"""
import subprocess, sys, time
from ciphernav_jax.lifeline import lifeline
with lifeline() as stdin:
    subprocess.Popen([sys.executable, "-c", {CHILD + "; import time; time.sleep(10**6)"!r}], stdin=stdin)
    time.sleep(10**6)
"""


def test_a_child_ends_when_its_parent_is_killed():
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    assert parent.stdout.readline() == "on\n"
    parent.kill()
    assert parent.stdout.read() == ""  # the child has it too: it is closed once both have ended
    parent.wait()


def test_a_child_whose_parent_lives_goes_on_to_its_end():
    code = f"""
import subprocess, sys
from ciphernav_jax.lifeline import lifeline
with lifeline() as stdin:
    print(subprocess.run([sys.executable, "-c", {CHILD!r}], stdin=stdin).returncode)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "on\n0\n"
