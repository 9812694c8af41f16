"""A managed node of a run: its parameters, its lifecycle, and its log."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.topics import NAMESPACE
from bmd_rths_nodes.roles import ROLES
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.ros.executable_help import OWN_PARAMETERS
from bmd_rths_nodes.ros.parameters import (
    changed_configuration,
    declare_configuration,
    read_configuration,
    refuse_other_name,
    refuse_unsupported,
)


class ManagedNode(LifecycleNode, ABC):
    """A lifecycle node with the parameters of its role, which can be changed while it is not configured."""

    ROLE: ClassVar[str]

    def __init__(self) -> None:
        super().__init__(self.ROLE, namespace=NAMESPACE)
        refuse_other_name(self, self.ROLE)
        self.config: Config = read_configuration(self)
        declare_configuration(self, self.config, ROLES[self.ROLE].sections)
        for name, (default, description) in OWN_PARAMETERS.items():
            self.declare_parameter(name, default, ParameterDescriptor(description=description))
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.problem = ""
        self.to_log: list[tuple[bytes, str]] = []
        self.configured = False

    # ---- for subclasses

    @abstractmethod
    def configure_stage(self, config: Config) -> None:
        """Make stage, publishers and subscriptions; may raise InputError."""

    def reset_stage(self) -> None:
        """Return the stage to rest, before step 0."""

    def stop_stage(self) -> None:
        """Leave everything safe; called when the node is deactivated or its process ends."""

    @abstractmethod
    def take_part(self) -> None:
        """Begin to take part in a test: the node is active."""

    @abstractmethod
    def take_no_part(self) -> None:
        """Take part in no test any more."""

    @abstractmethod
    def give_up_topics(self) -> None:
        """Destroy publishers and subscriptions."""

    def log_later(self, text: str, level: bytes = status.OK) -> None:
        """Log a line when no node of this process drives a test or a table: a log call may stall it."""
        self.to_log.append((level, text))

    @property
    def drives(self) -> bool:
        """True while something moves that must not wait for a log call."""
        return False

    def flush_log(self) -> None:
        """Log what was kept back."""
        while self.to_log:
            level, text = self.to_log.pop(0)
            if level == status.OK:
                self.get_logger().info(text)
            elif level == status.WARN:
                self.get_logger().warning(text)
            else:
                self.get_logger().error(text)

    # ---- lifecycle

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make stage and topics from the parameters."""
        try:
            self.configure_stage(self.config)
        except InputError as error:
            self.problem = str(error)
            self.get_logger().error(self.problem)
            self.give_up_topics()
            return TransitionCallbackReturn.FAILURE
        self.configured = True
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Return to rest and look for the peers."""
        try:
            self.reset_stage()
        except InputError as error:
            self.problem = str(error)
            self.get_logger().error(self.problem)
            return TransitionCallbackReturn.FAILURE
        self.take_part()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop taking part."""
        self.stop_stage()
        self.take_no_part()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give up stage and topics, so that the parameters can be changed."""
        self.give_up_topics()
        self.configured = False
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop taking part for good."""
        self.stop_stage()
        self.take_no_part()
        self.give_up_topics()
        self.configured = False
        return super().on_shutdown(state)

    def _LifecycleNodeMixin__on_change_state(self, request: Any, response: Any) -> Any:
        """Answer a request for a transition that is not possible, which rclpy 7.1 leaves unanswered."""
        try:
            return super()._LifecycleNodeMixin__on_change_state(request, response)  # type: ignore[misc]
        except rclpy_implementation.RCLError as error:
            self.get_logger().error(f"transition refused: {error}")
            response.success = False
            return response

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        if self.configured:
            reason = f"{self.ROLE} is configured; parameters can be changed after the cleanup transition"
            return SetParametersResult(successful=False, reason=reason)
        try:
            refuse_unsupported(parameters)
            self.config = changed_configuration(self.config, parameters)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)
