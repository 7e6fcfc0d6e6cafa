# doorcam in a container: docker build -t doorcam . && docker run --rm -p 127.0.0.1:8080:8080 doorcam
FROM rust:1-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends libclang1 && rm -rf /var/lib/apt/lists/*
WORKDIR /src
COPY Cargo.toml Cargo.lock ./
COPY src src
COPY web web
COPY config config
COPY benches benches
RUN cargo build --release --locked

FROM debian:bookworm-slim
RUN useradd --system --no-create-home doorcam
COPY --from=build /src/target/release/doorcam /usr/local/bin/doorcam
USER doorcam
EXPOSE 8080
# Inside a container loopback is nobody else's. The demo shows nobody real; whatever shows a real room takes DOORCAM_TOKEN.
CMD ["doorcam", "demo", "--listen", "0.0.0.0:8080", "--allow-unauthenticated"]
