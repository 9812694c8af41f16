"""Quality of service of every topic, and why.

Publishers offer *reliable* delivery and keep a history, because the recorder must not lose a message. The stages ask
for *best effort*: a lost message is a missed deadline, which is counted, and not a reason to wait. A reliable publisher
serves both kinds of subscription.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

#: Offered by every publisher of the loop: five seconds of messages at 200 Hz for the recorder to catch up.
PUBLISHER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)

#: Asked for by the stages in real time: no repetition of what is lost. After a stall of the machine a stage catches up
#: with every sample; a filter that skips one answers with a jump of its output (docs/decisions/0004).
STAGE = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)

#: Asked for in real time by a table driver that waits for a real controller: a command that a newer one has overtaken
#: is of no use to a table, and waiting for its answer would make the newer one late too.
NEWEST = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)

#: Asked for by the stages in lockstep, where every message starts the next one and none may be lost.
LOCKSTEP_STAGE = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)

#: Asked for by the recorder: five seconds of messages at 200 Hz.
RECORDER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)

DIAGNOSTICS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
