# Everything to run tests on the ROS graph: docker build -t bmd_rths . && docker run --rm --network host bmd_rths --help
# Bags are written into /work, and gone with the container where that is no folder of the host:
#     docker run --rm -it --network host --stop-timeout 60 -v "$PWD":/work bmd_rths run my_rig.yaml
# A loop in real time wants --network host (a table controller on UDP), --ulimit rtprio=20 and processors of its own.
FROM python:3.12-slim-bookworm
WORKDIR /opt/bmd_rths
COPY requirements.txt constraints.txt ./
COPY bmd_rths_core bmd_rths_core
COPY bmd_rths_msgs_py bmd_rths_msgs_py
COPY bmd_rths_nodes bmd_rths_nodes
COPY config config
RUN pip install --no-cache-dir -r requirements.txt
WORKDIR /work
# `docker stop` is Ctrl-C. The first process of a container ignores SIGTERM until it asks for it: a test that was just
# starting would go on, and be killed with a table that moves. It is killed all the same after --stop-timeout (10 s).
STOPSIGNAL SIGINT
ENTRYPOINT ["bmd-rths"]
CMD ["run", "/opt/bmd_rths/config/simplified_bmd.yaml", "--lockstep"]
