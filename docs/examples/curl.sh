#!/bin/sh
# What doorcam knows, with curl: sh curl.sh [URL [DIRECTORY]]
set -eu
url=${1:-http://127.0.0.1:8080}
directory=${2:-.}

# Everything that is JSON: --fail makes an error an error, whose body is a problem (RFC 9457).
curl --silent --show-error --fail "$url/api/v1/status"
echo
curl --silent --show-error --fail "$url/api/v1/tracks"
echo
curl --silent --show-error --fail "$url/api/v1/events?limit=10"
echo

# A picture, but only if it is another one than last time: curl keeps the ETag in a file.
curl --silent --show-error --fail --etag-save "$directory/etag" --output "$directory/reconstruction.png" \
  "$url/api/v1/reconstruction.png"

# Geometry changes with the calibration only: the second request is answered with 304 and no body.
curl --silent --show-error --fail --etag-save "$directory/geometry.etag" --output "$directory/geometry.json" \
  "$url/api/v1/geometry"
curl --silent --show-error --etag-compare "$directory/geometry.etag" --output "$directory/geometry.json" \
  --write-out 'geometry: %{http_code}\n' "$url/api/v1/geometry"
