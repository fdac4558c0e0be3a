# halpipe with its extras and the programs that some exports and checks start: docker build -t halpipe .
FROM python:3.13-slim-bookworm AS build
WORKDIR /source
COPY . .
RUN pip install --no-cache-dir --prefix=/installed ".[arxml,exact,table,serve,riscv]"

FROM python:3.13-slim-bookworm
RUN apt-get update \
    && apt-get install --no-install-recommends --yes graphviz make gcc libc6-dev \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /installed /usr/local
RUN useradd --create-home halpipe
USER halpipe
WORKDIR /work
ENTRYPOINT ["halpipe"]
