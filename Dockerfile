# halpipe with its extras and the programs that some exports and checks start: docker build -t halpipe .
FROM python:3.13-slim-bookworm AS build
WORKDIR /source
COPY . .
# hadolint ignore=DL3013
RUN pip install --no-cache-dir --prefix=/installed ".[arxml,exact,table,serve,riscv]"

FROM python:3.13-slim-bookworm
# Debian keeps one version of each package, so that a pinned one could not be installed soon.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --no-install-recommends --yes graphviz make gcc libc6-dev \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /installed /usr/local
RUN useradd --create-home --uid 1000 halpipe
USER 1000
WORKDIR /work
ENTRYPOINT ["halpipe"]
