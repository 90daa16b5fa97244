#!/bin/sh
# In the new root file system, last: the agent's environment, and what must not differ between two builds.
set -eu
export PYTHONHASHSEED=0 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore

python3 -m venv /opt/radron
/opt/radron/bin/pip install --quiet --no-index --no-deps --no-compile /tmp/wheels/*.whl
sh /tmp/prune.sh
rm -f /opt/radron/bin/radron-sim /opt/radron/bin/radron-deploy /opt/radron/bin/radron-station
# The slot cannot be written: bytecode is made now, and without dates.
/opt/radron/bin/python -m compileall -q -j 1 --invalidation-mode unchecked-hash /opt/radron/lib
/opt/radron/bin/python -P -c 'import radron.agent.shell.node, radron.agent.shell.supervisor, radron.agent.update.command'

# Accounts by the numbers of sysusers.d. No password fits `*`; a locked account (`!`) could not use its SSH key either.
systemd-sysusers
usermod --password '*' root

# What this release is: shown at the console, asked for by `radron-deploy`.
sed -i '/^\(PRETTY_NAME\|IMAGE_ID\|IMAGE_VERSION\|BUILD_ID\)=/d' /usr/lib/os-release
cat /usr/share/radron/release >> /usr/lib/os-release
dpkg-query --show --showformat '${Package} ${Version}\n' > /usr/share/radron/packages

mkdir -p /config /efi
: > /etc/machine-id
# Nobody can log in at the console, the package database never changes, nothing waits for the network to be up, and nothing of a desktop.
for unit in getty@tty1 serial-getty@ttyS0 systemd-firstboot systemd-networkd-wait-online e2scrub_reap systemd-logind systemd-binfmt; do
    ln -sf /dev/null "/etc/systemd/system/$unit.service"
done
for timer in dpkg-db-backup e2scrub_all; do ln -sf /dev/null "/etc/systemd/system/$timer.timer"; done
rm -f /etc/ssh/ssh_host_* /etc/hostname /etc/resolv.conf /boot/System.map-* /boot/config-*
rm -rf /tmp/wheels /tmp/prune.sh /var/cache/* /var/log/* /var/lib/apt /usr/share/i18n
rm -f /tmp/finish.sh
