"""Count the calls that the first log calls in the spin loop of a node make; with "cold", without the warm-up.

Their time would say as much about what else the machine does.
"""

import os
import signal
import sys

from bmd_rths_nodes.nodes.command_shaper import CommandShaperNode
from bmd_rths_nodes.ros import spin

if sys.argv[1] == "cold":
    spin.warm_up = lambda: None


events = []


class CountedNode(CommandShaperNode):
    """A node that logs at its hundredth look."""

    looks = 0

    def poll(self, now):
        self.looks += 1
        if self.looks == 100:
            for _ in range(3):
                events.clear()
                sys.setprofile(lambda frame, event, _: events.append(event))
                self.get_logger().error("table is stopped")
                sys.setprofile(None)
                print(sum(event in ("call", "c_call") for event in events), flush=True)
            os.kill(os.getpid(), signal.SIGINT)
        return min(super().poll(now), now + 0.001)


# What is in force of real time would be the first thing that is logged.
parameters = [word for given in ("run.record:=false", "real_time.time_slice:=0.0") for word in ("-p", given)]
sys.exit(spin.run_nodes([CountedNode], ["--ros-args", *parameters]))
