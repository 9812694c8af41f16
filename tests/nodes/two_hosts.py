"""Two hosts on one computer: run commands on both ends of a cable between two network namespaces.

To be started by `UNSHARE`; a JSON object with the commands of "here" and of "there" is its argument. Whatever it starts
ends with it.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

#: Namespaces of users, networks and processes that an ordinary user may make, where Linux allows it.
UNSHARE = ("unshare", "--user", "--map-root-user", "--net", "--pid", "--fork", "--kill-child", "--mount-proc")

#: Addresses of the two hosts.
HERE, THERE = "10.77.0.1", "10.77.0.2"

LONGEST = 90.0


def ip(*words, host=()):
    subprocess.run([*host, "ip", *words], check=True)


def cable():
    """Make the second host and the cable; return the host's process, and what runs a command there."""
    own = os.readlink("/proc/self/ns/net")
    other = subprocess.Popen(["unshare", "--net", "sleep", str(2 * LONGEST)])
    while os.readlink(f"/proc/{other.pid}/ns/net") == own:
        time.sleep(0.01)
    there = ("nsenter", "--target", str(other.pid), "--net")
    ip("link", "add", "here", "type", "veth", "peer", "name", "there")
    ip("link", "set", "there", "netns", str(other.pid))
    for host, name, address in (((), "here", HERE), (there, "there", THERE)):
        ip("address", "add", f"{address}/24", "dev", name, host=host)
        for device in (name, "lo"):
            ip("link", "set", device, "up", host=host)
        ip("route", "add", "224.0.0.0/4", "dev", name, host=host)
    return other, there


def main():
    other, there = cable()
    children = []
    for where, commands in json.loads(sys.argv[1]).items():
        for command in commands:
            on_host = there if where == "there" else ()
            with Path(f"{where}_{len(children)}.txt").open("wb") as output:
                children.append(subprocess.Popen([*on_host, *command], stdout=output, stderr=subprocess.STDOUT))
    give_up = time.monotonic() + LONGEST
    print([child.wait(max(0.0, give_up - time.monotonic())) for child in children])
    other.kill()


if __name__ == "__main__":
    main()
