# Removes what install.sh has made. With `purge` also what the drone has measured and recorded, and its user.
set -eu
if [ -d /run/systemd/system ]; then systemctl stop radron-clock.path radron-agent radron-provision 2>/dev/null || true; fi
systemctl --quiet disable radron-provision radron-agent radron-clock.path 2>/dev/null || true
rm -rf /etc/systemd/system/radron-agent.service /etc/systemd/system/radron-clock.path /etc/systemd/system/radron-clock.service
rm -rf /etc/systemd/system/radron-provision.service /etc/systemd/system/radron-provision.service.d
rm -rf /usr/lib/radron /run/radron /etc/udev/rules.d/60-radron.rules /etc/sysusers.d/radron.conf
if [ -e /etc/chrony/conf.d/radron.conf ]; then
    rm -f /etc/chrony/sources.d/radron.sources /etc/chrony/conf.d/radron.conf
    if [ -d /run/systemd/system ]; then systemctl try-restart chrony || true; fi
fi
rm -rf /etc/radron /etc/radron.new /etc/radron.old /var/tmp/radron-install
for name in ca.pem certificate.pem key.pem revoked.crl; do rm -f "/run/credstore/$name"; done
rm -rf /opt/radron /opt/radron.new /opt/radron-*
if [ -d /run/systemd/system ]; then
    systemctl daemon-reload
    systemctl reset-failed radron-clock.service radron-agent radron-provision 2>/dev/null || true
fi
if [ "${1:-}" = purge ]; then
    rm -rf /var/lib/radron
    userdel radron 2>/dev/null || true
    echo "removed, with all that it had measured and recorded"
elif [ -d /var/lib/radron ]; then
    echo "removed; what the drone has measured and recorded stays in /var/lib/radron ($(du -sh /var/lib/radron | cut -f1)), --purge removes it"
else
    echo "removed"
fi
