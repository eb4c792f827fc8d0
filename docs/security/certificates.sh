#!/bin/sh
# One certificate a role: certificates.sh FOLDER HOST ROLE…   HOST is the router's name or address.
#
#   docs/security/certificates.sh keys range.example router station theo-north theo-east radar-1 ins viewer
#
# Each role's common name is its name in docs/security/router.json5. Give every machine ca.pem and its own
# two files, nothing else; ca.key stays where it was made. Run again with the same FOLDER to add roles.
set -eu
umask 077
folder=$1 host=$2
shift 2
mkdir -p "$folder"
cd "$folder"
case $host in
*[!0-9.]*) names="DNS:$host" ;;
*) names="IP:$host" ;;
esac
key() { openssl genpkey -algorithm EC -pkeyopt ec_paramgen_curve:prime256v1 -out "$1.key" 2>/dev/null; }
if [ ! -f ca.key ]; then
    key ca
    openssl req -x509 -new -key ca.key -subj "/CN=range authority" -days 3650 -out ca.pem \
        -addext "basicConstraints=critical,CA:TRUE" -addext "keyUsage=critical,keyCertSign"
fi
for role in "$@"; do
    [ ! -f "$role.pem" ] || continue
    key "$role"
    {
        echo "basicConstraints=CA:FALSE"
        echo "extendedKeyUsage=serverAuth,clientAuth"
        echo "subjectAltName=$names"
    } >"$role.ext"
    openssl req -new -key "$role.key" -subj "/CN=$role" |
        openssl x509 -req -CA ca.pem -CAkey ca.key -days 825 -extfile "$role.ext" -out "$role.pem" 2>/dev/null
    rm "$role.ext"
done
