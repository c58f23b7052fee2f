# Headstock in a container of its own; elsewhere ./headstock needs none.
#
#   docker build -t headstock .
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/work" -w /work headstock run scene.toml
FROM debian:13
COPY environment/packages.txt environment/pictures.txt environment/test_data.txt /tmp/
RUN apt-get update \
    && grep -v -e '^#' -e '^$' /tmp/packages.txt | xargs apt-get install -y --no-install-recommends \
    && python3 -m pip install --break-system-packages --no-cache-dir --require-hashes --no-deps -r /tmp/pictures.txt -r /tmp/test_data.txt \
    && rm -rf /var/lib/apt/lists/* /tmp/packages.txt /tmp/pictures.txt /tmp/test_data.txt
COPY . /opt/headstock
# bytecode beforehand, because an ordinary user may not write there
RUN useradd --create-home somebody && chmod -R a+rX /opt/headstock && python3 -m compileall -q /opt/headstock
USER somebody
ENTRYPOINT ["/opt/headstock/headstock"]
CMD ["--help"]
