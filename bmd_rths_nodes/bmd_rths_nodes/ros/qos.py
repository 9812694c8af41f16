"""Quality of service of every topic, and why.

Publishers offer *reliable* delivery and keep a history, because the recorder must not lose a message. The stages ask
for *best effort*: a lost message is a missed deadline, which is counted, and not a reason to wait. A reliable publisher
serves both kinds of subscription.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _profile(depth: int, reliability: ReliabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=reliability, durability=DurabilityPolicy.VOLATILE
    )


#: Offered by every publisher of the loop: five seconds of messages at 200 Hz for the recorder to catch up.
PUBLISHER = _profile(1000, ReliabilityPolicy.RELIABLE)

#: Asked for by the stages in real time: no repetition of what is lost. After a stall of the machine a stage catches up
#: with every sample; a filter that skips one answers with a jump of its output (docs/decisions/0004).
STAGE = _profile(10, ReliabilityPolicy.BEST_EFFORT)

#: Asked for in real time by a table driver that waits for a real controller: a command that a newer one has overtaken
#: is of no use to a table, and waiting for its answer would make the newer one late too.
NEWEST = _profile(1, ReliabilityPolicy.BEST_EFFORT)

#: Asked for by the stages in lockstep, where every message starts the next one and none may be lost.
LOCKSTEP_STAGE = _profile(10, ReliabilityPolicy.RELIABLE)

#: Asked for by the recorder: five seconds of messages at 200 Hz.
RECORDER = _profile(1000, ReliabilityPolicy.RELIABLE)

#: Asked for by who only watches, as the page of a monitor on another computer: nothing is sent again for it.
WATCHER = _profile(1000, ReliabilityPolicy.BEST_EFFORT)

DIAGNOSTICS = _profile(100, ReliabilityPolicy.RELIABLE)

#: Calls of an operator, or of a program that calls without end: each is answered. Not KEEP_ALL, whose full queue would
#: make an answer wait for a client that is gone.
OPERATOR = QoSProfile(depth=2000)
