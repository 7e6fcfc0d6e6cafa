# The demo: docker build -t doorcam . && docker run --rm -p 127.0.0.1:8080:8080 doorcam
# A camera: docker run --rm -p 8080:8080 --device /dev/video0 --group-add video -v doorcam:/var/lib/doorcam \
#   -e DOORCAM_TOKEN=... doorcam doorcam serve --source v4l2:/dev/video0 --listen 0.0.0.0:8080
# scripts/container runs these steps without a container engine.
FROM rust:1-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates libclang1 && rm -rf /var/lib/apt/lists/*
WORKDIR /src
COPY Cargo.toml Cargo.lock ./
# Cargo requires every target that the manifest names to exist.
COPY benches benches
COPY config/doorcam.toml config/
COPY web web
COPY crates crates
COPY src src
ENV CARGO_PROFILE_RELEASE_STRIP=true
RUN cargo build --release --locked --bin doorcam

FROM debian:bookworm-slim
RUN useradd --system --no-create-home doorcam && install -d -o doorcam -m 700 /var/lib/doorcam
# Root certificates, for TLS to MQTT brokers and webhook receivers.
COPY --from=build /etc/ssl/certs/ca-certificates.crt /etc/ssl/certs/
COPY --from=build /src/target/release/doorcam /usr/local/bin/
USER doorcam
EXPOSE 8080
# Data kept between runs: mount a volume here.
ENV STATE_DIRECTORY=/var/lib/doorcam
VOLUME /var/lib/doorcam
# The image has no curl.
HEALTHCHECK --start-period=30s --interval=30s --timeout=5s CMD ["bash", "-c", \
  "exec 3<>/dev/tcp/127.0.0.1/8080; printf 'GET /readyz HTTP/1.0\\r\\nHost: localhost\\r\\n\\r\\n' >&3; grep -q '^HTTP/1.. 200' <&3"]
# Loopback is not reachable from outside the container, so listen on all addresses. The demo needs no token because it
# shows nobody real; for a real room set DOORCAM_TOKEN.
CMD ["doorcam", "demo", "--listen", "0.0.0.0:8080", "--allow-unauthenticated"]
