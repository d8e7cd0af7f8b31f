# All of the project, for CPUs:
#   docker build -t shaftpose .
#   docker run --rm -v "$PWD/outputs:/shaftpose/outputs" shaftpose shaftpose demo --out outputs/demo
FROM python:3.11-slim-bookworm

WORKDIR /shaftpose
ENV PIP_NO_CACHE_DIR=1

# What check_system.py asks for, as it names the packages; `make env` asks again.
COPY tools/check_system.py tools/
RUN apt-get update \
    && apt-get install -y --no-install-recommends git make \
    && python3.11 tools/check_system.py 2>&1 | sed -n 's/.*run: sudo //p' | sh \
    && rm -rf /var/lib/apt/lists/*

# PyTorch's default build would bring several GB of CUDA libraries.
COPY constraints.txt .
RUN python3.11 -m venv .venv \
    && .venv/bin/pip install $(grep ^torch== constraints.txt) \
        --index-url https://download.pytorch.org/whl/cpu

COPY . .
RUN make env
ENV PATH=/shaftpose/.venv/bin:$PATH GLIBC_TUNABLES=glibc.malloc.hugetlb=1

CMD ["make", "help"]
