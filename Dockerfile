# The stack with its Python environment and compiled kernels: docs/how-to/install.md.
FROM debian:bookworm
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates
WORKDIR /opt/vsx_ros
COPY . .
RUN scripts/demo --help && ~/.local/share/vsx_ros/venv/bin/python3 -m vsx_ros.cli.compiled && apt-get clean
ENV PATH=/opt/vsx_ros/scripts:$PATH ROS_PACKAGE_PATH=/opt/vsx_ros:/usr/share
CMD ["scripts/demo", "--headless"]
