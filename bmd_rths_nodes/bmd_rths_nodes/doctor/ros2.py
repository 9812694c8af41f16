"""The same looks as a check of ``ros2 doctor``, where ros2cli is there; nothing is measured."""

from __future__ import annotations

from ros2doctor.api import DoctorCheck, Result
from ros2doctor.api.format import doctor_error, doctor_warn

from bmd_rths_nodes.doctor.finding import PROBLEM, WARNING
from bmd_rths_nodes.doctor.machine import Machine


class BmdRthsCheck(DoctorCheck):
    """Look at what a test in real time needs."""

    def category(self) -> str:
        """Return the name of the check."""
        return "bmd_rths"

    def check(self) -> Result:
        """Look at this computer, print what is to be changed, and count it."""
        result = Result()
        for finding in Machine().findings():
            text = f"bmd_rths: {finding.name}: {finding.found}; {finding.advice}"
            if finding.level == PROBLEM:
                doctor_error(text)
                result.add_error()
            elif finding.level == WARNING:
                doctor_warn(text)
                result.add_warning()
        return result
