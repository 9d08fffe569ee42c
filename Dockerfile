# The command line in a container: docs/service.md.
FROM python:3.12-slim

ARG EXTRAS=
ENV VIRTUAL_ENV=/opt/venv PATH=/opt/venv/bin:$PATH NUMBA_CACHE_DIR=/opt/kernels

COPY pyproject.toml LICENSE /src/
COPY src /src/src
RUN python -m venv /opt/venv && pip install --no-cache-dir "/src${EXTRAS}" && rm -r /src

# Trims the sample: the image is not made if that fails, and it keeps the kernels that are compiled for it.
RUN mkdir -p /opt/kernels \
    && gaussian-trimmer demo --quiet --output /tmp/demo && test -s /tmp/demo/object.ply && rm -r /tmp/demo \
    && chmod -R a+rwX /opt/kernels

USER 1000
WORKDIR /data
ENTRYPOINT ["gaussian-trimmer"]
CMD ["--help"]
