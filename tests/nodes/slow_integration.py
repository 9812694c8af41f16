"""A numerical substructure that is slow for a while, and then too slow, in the process that integrates."""

import os
import sys
import time

from bmd_rths_core.stages.numerical_substructure import NumericalSubstructure
from bmd_rths_nodes.hardware.integration_process import IntegrationProcess, serve
from bmd_rths_nodes.nodes import composed_loop, numerical_substructure

#: Environment variable: pairs of an integration and how long those from it on take [s], as 20:0.01,30:0.05.
VARIABLE = "BMD_RTHS_TEST_SLOW"


class SlowSubstructure(NumericalSubstructure):
    """It sleeps."""

    def reset(self):
        super().reset()
        self._count = 0

    def step(self, ground_acceleration, feedback_force):
        response = super().step(ground_acceleration, feedback_force)
        pairs = (pair.split(":") for pair in os.environ[VARIABLE].split(","))
        time.sleep(max((float(duration) for begin, duration in pairs if int(begin) <= self._count), default=0.0))
        self._count += 1
        return response


def composed_nodes():
    """Run the composed loop with it."""
    numerical_substructure.IntegrationProcess = lambda config: IntegrationProcess(config, __name__)
    return composed_loop.main()


if __name__ == "__main__":
    sys.exit(serve(lambda config: SlowSubstructure(config.elastic_substructure(), config.integration_step)))
