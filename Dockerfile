# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0

# ROS 2 Jazzy with both packages: the steps of README for a workspace.
#
#   docker build -t rpms_ros .
#   docker run --rm -it --net=host --ipc=host rpms_ros ros2 launch rpms_ros simulation.launch.py
#
# --net=host and --ipc=host let nodes in the container and outside of it find each other.  A driver
# with a real device also needs --device=/dev/ttyUSB0 and the folders of patient, ledger and audit log.
FROM ros:jazzy-ros-base

ARG DEBIAN_FRONTEND=noninteractive
ENV PIP_BREAK_SYSTEM_PACKAGES=1 PIP_NO_CACHE_DIR=1
RUN apt-get update && apt-get install --yes --no-install-recommends \
        python3-colcon-common-extensions python3-pip python3-rosdep \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /workspace
COPY . src/rpms_ros
RUN apt-get update && rosdep update \
    && rosdep install --from-paths src src/rpms_ros/msg_defs --ignore-src -y \
    && python3 -m pip install numba==0.68.1 \
    && rm -rf /var/lib/apt/lists/*
RUN . /opt/ros/jazzy/setup.sh && colcon build --base-paths src src/rpms_ros/msg_defs
# the image of ROS sources the installation in its entry point; this one is added to it, without the
# arguments of the container
RUN sed -i 's|^exec |. /workspace/install/setup.bash --\nexec |' /ros_entrypoint.sh \
    && grep --quiet workspace /ros_entrypoint.sh
CMD ["ros2", "launch", "rpms_ros", "simulation.launch.py", "--show-args"]
