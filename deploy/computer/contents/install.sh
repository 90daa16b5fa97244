# install.sh RELEASE PYTHON: makes this computer a drone's, from the files beside this script; the drone's own come by standard input.
# Every step can be repeated. The environment that is in use is replaced by renaming a link, when the new one is complete.
set -eu
release=$1 python=$2
here=$(cd "$(dirname "$0")" && pwd)
place=/opt/radron-$release
umask 022

if [ ! -e "$place/complete" ]; then
    echo "the agent's environment, a minute"
    rm -rf "$place" "$here/wheels"
    tar -xf "$here/packages-$release.tar" --no-same-owner -C "$here"
    "$python" -m venv --without-pip "$place"
    pip="$place/bin/python $(ls "$here"/wheels/pip-*.whl)/pip --disable-pip-version-check --quiet install --root-user-action=ignore --no-compile"
    if [ -e "$here/wheels/constraints.txt" ]; then
        $pip --constraint "$here/wheels/constraints.txt" "$here"/wheels/radron-*.whl
    else
        $pip --no-index --no-deps $(ls "$here"/wheels/*.whl | grep -v '/pip-[^/]*$')
    fi
    rm -f "$place/bin/radron-sim" "$place/bin/radron-deploy" "$place/bin/radron-station" # they are not among what flies
    "$place/bin/python" -m compileall -q "$place/lib" || true # some packages hold files for other versions of Python
    "$place/bin/python" -P -c 'import radron.agent.shell.node, radron.agent.shell.supervisor'
    : > "$place/complete"
fi

echo "the drone's files"
rm -rf /etc/radron.new
mkdir -m 0700 /etc/radron.new
tar -xf - -C /etc/radron.new
if [ ! -d /etc/radron.new/identity ]; then cp -rp /etc/radron/identity /etc/radron.new/; fi # its certificate is still good
if [ -e /etc/radron.new/revoked.crl ]; then mv /etc/radron.new/revoked.crl /etc/radron.new/identity/; fi
chmod -R go= /etc/radron.new
rm -rf /etc/radron.old
[ ! -d /etc/radron ] || mv /etc/radron /etc/radron.old
mv /etc/radron.new /etc/radron
rm -rf /etc/radron.old

echo "the service"
(cd "$here/system" && find . -type f -exec install -D --preserve-timestamps --mode=0644 {} /{} \;)
chmod 0755 /usr/lib/radron/*
systemd-sysusers /etc/sysusers.d/radron.conf
ln -sfn "$place" /opt/radron.new
"$place/bin/python" -c 'import os; os.replace("/opt/radron.new", "/opt/radron")' # by one step; not every mv does that with links
for old in /opt/radron-*; do [ "$old" = "$place" ] || rm -rf "$old"; done
[ -d /etc/chrony/sources.d ] || echo "there is no chrony, so its clock follows no other drone's: apt-get install chrony, and run this again"
systemctl --quiet enable radron-provision radron-agent radron-clock.path
if [ ! -d /run/systemd/system ]; then
    echo "systemd does not run here: the agent starts with the next boot"
    exit 0
fi
systemctl daemon-reload
udevadm control --reload 2>/dev/null && udevadm trigger --subsystem-match=usb 2>/dev/null || true
systemctl restart radron-provision radron-clock.path
systemctl --quiet is-active chrony && systemctl restart chrony || true
systemctl restart --no-block radron-agent
# What it says first: what it waits for, or that it is ready.
for _ in $(seq 300); do
    status=$(systemctl show --property=StatusText --value radron-agent)
    case $status in '' | starting) sleep 0.2 ;; *) break ;; esac
done
echo "the agent runs: ${status:-it has said nothing yet; see journalctl -u radron-agent}"
