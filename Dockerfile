# svbrdfgan with all renderers, for CPUs. CI does not build this file.
#   docker build -t svbrdfgan .
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/data" svbrdfgan weather my_car.glb -o dirty.glb
FROM python:3.11-slim

COPY . /src
RUN PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu \
    pip install --no-cache-dir --constraint /src/constraints.txt '/src[all]' \
    && rm -r /src \
    && useradd --create-home svbrdfgan \
    && mkdir --mode 1777 /cache

USER svbrdfgan
# where caches of compiled kernels may be written, whoever the container runs as
ENV XDG_CACHE_HOME=/cache
WORKDIR /data
ENTRYPOINT ["svbrdfgan"]
