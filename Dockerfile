# The dashboard for a laboratory server: see docs/deploy.md.
FROM python:3.12-slim

RUN useradd --create-home --uid 10001 stereocal \
    && mkdir /projects \
    && chown stereocal /projects

WORKDIR /app
COPY requirements.txt ./
RUN pip install --no-cache-dir --requirement requirements.txt

COPY app.py LICENSE ./
COPY .streamlit .streamlit
COPY assets assets
COPY pages pages
COPY sample_data sample_data
COPY stereocal stereocal

# Compiled code is kept in the image: the first calibration of a container does not wait for it.
ENV NUMBA_CACHE_DIR=/app/compiled \
    OMP_NUM_THREADS=1 \
    PYTHONUNBUFFERED=1
RUN mkdir /app/compiled \
    && python -m stereocal compile \
    && chown -R stereocal /app/compiled

USER stereocal
ENV STEREOCAL_HOME=/projects \
    STEREOCAL_SHARED=1 \
    STREAMLIT_SERVER_SCRIPT_HEALTH_CHECK_ENABLED=true
VOLUME /projects
EXPOSE 8501
# It draws the Start page, and fails where the application cannot be imported: /_stcore/health is
# well as long as Streamlit runs.
HEALTHCHECK --interval=30s --timeout=20s --start-period=60s \
    CMD python -c "from urllib.request import urlopen; urlopen('http://127.0.0.1:8501/_stcore/script-health-check', timeout=19)"
CMD ["streamlit", "run", "app.py", "--server.address", "0.0.0.0", "--server.headless", "true"]
