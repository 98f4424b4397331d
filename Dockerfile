# The program in a slim image, without a driver: the processor draws. With the toolkit of NVIDIA its GPU draws.
#
#     docker build -t voxsplat .
#     docker run --rm -v "$PWD:/data" voxsplat render scan.nii.gz -o scan.png
#     docker run --rm --gpus all -v "$PWD:/data" voxsplat render scan.nii.gz -o scan.png
FROM rust:1-slim-bookworm AS build
WORKDIR /source
COPY . .
RUN cargo build --release --locked --package voxsplat-cli && strip target/release/voxsplat

FROM debian:bookworm-slim
# Vulkan's loader, and the libraries that NVIDIA's driver opens.
RUN apt-get update \
    && apt-get install -y --no-install-recommends libegl1 libvulkan1 libxext6 \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /source/target/release/voxsplat /usr/local/bin/voxsplat
COPY LICENSE-MIT LICENSE-APACHE /usr/share/doc/voxsplat/
ENV NVIDIA_DRIVER_CAPABILITIES=graphics,utility
USER 1000
WORKDIR /data
ENTRYPOINT ["voxsplat"]
CMD ["--help"]
