#!/usr/bin/env bash
# A real SLURM of one node on this machine, to try docs/howto/cluster.md: slurm_node.sh start|stop FOLDER [CPUS]
# CPUS: jobs of one core at a time, by default as many as there are cores.
# Needs root and Debian's packages: apt-get install -y --no-install-recommends slurmctld slurmd slurm-client munge
# It replaces /etc/slurm/slurm.conf. No systemd, no cgroups, no accounting database.
set -euo pipefail
action=${1:?start or stop} folder=$(realpath -m "${2:?a folder for state and logs}") cpus=${3:-$(nproc)} host=$(hostname -s)

stop() {
  local name
  for name in d ctld; do if [ -f "$folder/$name.pid" ]; then kill "$(cat "$folder/$name.pid")" || true; fi; done
  if [ -f /run/munge/munged.pid ]; then kill "$(cat /run/munge/munged.pid)" || true; fi
}

start() {
  mkdir -p "$folder"/{ctld,d,log} /etc/slurm
  if [ ! -f /etc/munge/munge.key ]; then mungekey --create; fi
  install -d -o munge -g munge -m 755 /run/munge
  install -d -o munge -g munge -m 700 /var/lib/munge /var/log/munge
  runuser -u munge -- munged --force
  cat >"$folder/slurm.conf" <<CONF
ClusterName=local
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmdUser=root
StateSaveLocation=$folder/ctld
SlurmdSpoolDir=$folder/d
SlurmctldPidFile=$folder/ctld.pid
SlurmdPidFile=$folder/d.pid
SlurmctldLogFile=$folder/log/ctld.log
SlurmdLogFile=$folder/log/d.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
ReturnToService=2
SchedulerParameters=sched_interval=1,batch_sched_delay=0
SlurmdParameters=config_overrides
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
AccountingStorageType=accounting_storage/none
MinJobAge=3600
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cpus RealMemory=$(awk '/MemTotal/ {print int($2 / 1024 * 0.9)}' /proc/meminfo)
PartitionName=debug Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
  # The plugin clears SLURM_* for its jobs, so SLURM_CONF is not enough.
  ln -sf "$folder/slurm.conf" /etc/slurm/slurm.conf
  slurmctld -i
  slurmd
  timeout 30 bash -c 'until sinfo -h -o %T | grep -q idle; do sleep 0.2; done'
  sinfo
}

"$action"
